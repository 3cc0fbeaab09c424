"""How kernels are compiled by numba, for the senses that have some.

A cached kernel is compiled again when its own file changes, not when a file it took something from does.
So a kernel calls only kernels of its own module and takes constants of other modules as arguments
(a test holds this).
"""

from collections.abc import Callable
from typing import Any

from numba import njit

# Fused and reordered sums; NaN and infinity keep their meaning, and the process its rounding modes.
# Without "arcp": LLVM would divide by the processor's approximate reciprocal, which AMD and Intel round
# differently.
RELAXED = frozenset({"contract", "reassoc", "nsz"})


def kernel(function: Callable[..., Any]) -> Any:
    """Compile exactly as written, in IEEE arithmetic."""
    return _compiled(function, frozenset())


def relaxed_kernel(function: Callable[..., Any]) -> Any:
    """Compile with sums reordered for vector registers, the same way at every call."""
    return _compiled(function, RELAXED)


def _compiled(function: Callable[..., Any], flags: frozenset[str]) -> Any:
    # A set without flags means false to numba, which is what it must be.
    options = {"nogil": True, "fastmath": set(flags) if flags else False, "error_model": "numpy"}
    try:
        return njit(function, cache=True, **options)
    except RuntimeError:
        # Neither this folder nor the user's cache folder can be written: each process compiles anew.
        return njit(function, **options)
