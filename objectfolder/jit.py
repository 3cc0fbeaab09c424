"""How kernels are compiled by numba, for the senses that have some.

A cached kernel is compiled again when its own file changes, not when a file it took something from does.
So a kernel calls only kernels of its own module and takes constants of other modules as arguments
(a test holds this). Of a named tuple the cache knows the class and the types of the fields, not their
order: who reorders alike fields clears the cache.

The target is the same on every x86-64 processor with AVX2, newer ones included: processes that share a cache
of kernels share the kernels, and answers do not depend on wider registers. It holds for all numba functions
of the process, unless ``NUMBA_CPU_NAME`` names another.
"""

import functools
import gc
import logging
from collections.abc import Callable
from typing import Any

import llvmlite.binding
from numba import config, njit, types
from numba.core import event
from numba.core.registry import CPUDispatcher
from numba.core.targetconfig import ConfigStack
from numba.core.types.functions import BaseFunction

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
ONCE = "8 to 15 s for sight and for touch, 6 s for sound, once for this installation"
EACH_TIME = (
    "8 to 15 s for sight and for touch, 6 s for sound, in every process: neither the folder of this "
    "package nor the user's cache folder can be written. Set NUMBA_CACHE_DIR to a folder that can be."
)
_logger = logging.getLogger(__name__)


def kernel(function: Callable[..., Any], **kind: bool) -> Any:
    """Compile exactly as written, in IEEE arithmetic."""
    return _compiled(function, frozenset(), **kind)


def relaxed_kernel(function: Callable[..., Any], **kind: bool) -> Any:
    """Compile with sums reordered for vector registers, the same way at every call."""
    return _compiled(function, RELAXED, **kind)


def arrayless(decorator: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel of a kind that makes no arrays, in less time: no references to arrays are counted."""
    return functools.partial(decorator, allocates=False)


def inner(decorator: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel of a kind that kernels alone call, in less time: Python cannot call it."""
    return functools.partial(decorator, from_python=False)


def _compiled(
    function: Callable[..., Any], flags: frozenset[str], allocates: bool = True, from_python: bool = True
) -> Any:
    # A set without flags means false to numba, which is what it must be.
    options = {
        "nogil": True,
        "fastmath": set(flags) if flags else False,
        "error_model": "numpy",
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": not from_python,
        "_nrt": allocates,
    }
    try:
        dispatcher = njit(function, cache=True, **options)
    except RuntimeError:
        # Neither this folder nor the user's cache folder can be written: each process compiles anew.
        _Compiling.cached = False
        dispatcher = njit(function, **options)
    if not from_python:
        dispatcher.__class__ = _InnerDispatcher
    return dispatcher


class _InnerDispatcher(CPUDispatcher):
    """Of an inner kernel: numba would follow a null pointer."""

    def __call__(self, *arguments: Any) -> Any:
        raise TypeError(f"{self.py_func.__qualname__} is called by kernels alone: it is an inner one.")


class _Signatures:
    """Signatures of calls of numba's own functions, each resolved once for equal types and flags.

    Numba resolves a call at every look at a function's variables, until their types no longer change, and
    again when it writes code: of ten resolutions for a first query, two are of a new call.
    """

    def __init__(self) -> None:
        self._by_flags: dict[Any, dict[Any, Any]] = {}
        self._flags: Any = None
        self._signatures: dict[Any, Any] = self._by_flags.setdefault(None, {})

    def of(self, function: types.Function, context: Any, arguments: Any, keywords: Any) -> Any:
        """Return the signature of a call; arguments as of `types.Function.get_call_type`."""
        flags = ConfigStack.top_or_none()
        if flags is not self._flags:
            # Flags take long to compare, and are the same object while a kernel is compiled.
            self._flags, self._signatures = flags, self._by_flags.setdefault(flags and flags.copy(), {})
        call = function, context, tuple(arguments), tuple(keywords.items())
        signature = self._signatures.get(call)
        if signature is None:
            signature = BaseFunction.get_call_type(function, context, arguments, keywords)
            self._signatures[call] = signature
        return signature


class _Compiling(event.Listener):
    """Logs a warning, once a process, that kernels are compiled; those in the cache load silently.

    Python shows warnings on standard error unless the caller configures logging;
    ``logging.getLogger("objectfolder.jit").setLevel("ERROR")`` silences this one.

    Garbage is not collected meanwhile: numba keeps what it makes, and looking through it is a twentieth of
    the time. Signatures of the package's kernels are those of `_Signatures`, an eighth of it.
    """

    cached = True  # whether numba's cache can be written
    reported, nested, collected = False, 0, False
    signatures = _Signatures()

    def on_start(self, event: event.Event) -> None:
        module = event.data["dispatcher"].py_func.__module__ or ""
        own = module.startswith("objectfolder.")
        if self.nested == 0:
            self.collected = gc.isenabled()
            gc.disable()
            if own:
                types.Function.get_call_type = lambda *call: self.signatures.of(*call)
        self.nested += 1
        if not self.reported and own:
            self.reported = True
            _logger.warning("objectfolder: compiling kernels, %s", ONCE if self.cached else EACH_TIME)

    def on_end(self, event: event.Event) -> None:
        self.nested -= 1
        if self.nested == 0:
            if self.collected:
                gc.enable()
            if "get_call_type" in vars(types.Function):
                del types.Function.get_call_type


def _set_target() -> None:
    host = llvmlite.binding.get_host_cpu_features()
    if config.CPU_NAME is None and all(host.get(name[1:], False) for name in CPU_FEATURES.split(",")):
        config.CPU_NAME, config.CPU_FEATURES = CPU_NAME, CPU_FEATURES


_set_target()
event.register("numba:compile", _Compiling())
