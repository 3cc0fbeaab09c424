"""How kernels are compiled by numba, for the senses that have some.

A cached kernel is compiled again when its own file changes, not when a file it took something from does.
So a kernel calls only kernels of its own module and takes constants of other modules as arguments
(a test holds this). Of a named tuple the cache knows the class and the types of the fields, not their
order: who reorders alike fields clears the cache.

The target is the same on every x86-64 processor with AVX2, newer ones included: processes that share a cache
of kernels share the kernels, and answers do not depend on wider registers. It holds for all numba functions
of the process, unless ``NUMBA_CPU_NAME`` names another.
"""

import gc
import logging
from collections.abc import Callable
from typing import Any

import llvmlite.binding
from numba import config, njit
from numba.core import event

# Fused and reordered sums; NaN and infinity keep their meaning, and the process its rounding modes.
# Without "arcp": LLVM would divide by the processor's approximate reciprocal, which AMD and Intel round
# differently.
RELAXED = frozenset({"contract", "reassoc", "nsz"})
CPU_NAME = "haswell"
# Those of `CPU_NAME` that change what is computed, and what LLVM needs beside them.
CPU_FEATURES = (
    "+64bit,+avx,+avx2,+bmi,+bmi2,+cmov,+cx16,+f16c,+fma,+fxsr,+lzcnt,+mmx,+movbe,+popcnt,+sahf,"
    "+sse,+sse2,+sse3,+sse4.1,+sse4.2,+ssse3,+xsave"
)

# CPU seconds on a processor of 2020. A busy machine takes longer.
ONCE = "15 to 25 s for sight and for touch, 6 s for sound, once for this installation"
EACH_TIME = (
    "15 to 25 s for sight and for touch, 6 s for sound, in every process: neither the folder of this "
    "package nor the user's cache folder can be written. Set NUMBA_CACHE_DIR to a folder that can be."
)
_logger = logging.getLogger(__name__)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile exactly as written, in IEEE arithmetic."""
    return _compiled(function, frozenset())


def relaxed_kernel(function: Callable[..., Any]) -> Any:
    """Compile with sums reordered for vector registers, the same way at every call."""
    return _compiled(function, RELAXED)


def arrayless(kind: Callable[..., Any]) -> Callable[[Callable[..., Any]], Any]:
    """Compile a kernel of a kind that makes no arrays, in less time: no references to arrays are counted."""
    return lambda function: _compiled(function, RELAXED if kind is relaxed_kernel else frozenset(), False)


def _compiled(function: Callable[..., Any], flags: frozenset[str], allocates: bool = True) -> Any:
    # A set without flags means false to numba, which is what it must be.
    options = {
        "nogil": True,
        "fastmath": set(flags) if flags else False,
        "error_model": "numpy",
        "no_cfunc_wrapper": True,
        "_nrt": allocates,
    }
    try:
        return njit(function, cache=True, **options)
    except RuntimeError:
        # Neither this folder nor the user's cache folder can be written: each process compiles anew.
        _Compiling.cached = False
        return njit(function, **options)


class _Compiling(event.Listener):
    """Logs a warning, once a process, that kernels are compiled; those in the cache load silently.

    Python shows warnings on standard error unless the caller configures logging;
    ``logging.getLogger("objectfolder.jit").setLevel("ERROR")`` silences this one.

    Garbage is not collected meanwhile: numba keeps what it makes, and looking through it is a twentieth of
    the time.
    """

    cached = True  # whether numba's cache can be written
    reported, nested, collected = False, 0, False

    def on_start(self, event: event.Event) -> None:
        if self.nested == 0:
            self.collected = gc.isenabled()
            gc.disable()
        self.nested += 1
        module = event.data["dispatcher"].py_func.__module__ or ""
        if not self.reported and module.startswith("objectfolder."):
            self.reported = True
            _logger.warning("objectfolder: compiling kernels, %s", ONCE if self.cached else EACH_TIME)

    def on_end(self, event: event.Event) -> None:
        self.nested -= 1
        if self.nested == 0 and self.collected:
            gc.enable()


def _set_target() -> None:
    host = llvmlite.binding.get_host_cpu_features()
    if config.CPU_NAME is None and all(host.get(name[1:], False) for name in CPU_FEATURES.split(",")):
        config.CPU_NAME, config.CPU_FEATURES = CPU_NAME, CPU_FEATURES


_set_target()
event.register("numba:compile", _Compiling())
