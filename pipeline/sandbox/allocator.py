"""Sets the memory allocator of a task's process to keep the memory of freed arrays.

By default, glibc returns every large array to the system and asks for the next one anew, whose pages are
then zeroed one by one: a sixth of the CPU seconds of all stages together (the starter set, made small).
"""

import contextlib
import ctypes
from collections.abc import Mapping

# Arrays up to the first come from the heap; free memory at its end goes back when it exceeds the second.
LARGEST_IN_HEAP_BYTES = 256 << 20
KEPT_BYTES = 512 << 20
GLIBC: Mapping[str, str] = {
    "MALLOC_MMAP_THRESHOLD_": str(LARGEST_IN_HEAP_BYTES),
    "MALLOC_TRIM_THRESHOLD_": str(KEPT_BYTES),
}


def give_back() -> None:
    """Return what is free to the system; other C libraries than glibc do so by themselves or not at all."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
