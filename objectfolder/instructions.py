"""Which kernels OpenBLAS takes: the same in commands, notebooks, tests and the factory's processes.

OpenBLAS, which NumPy and SciPy bring, chooses kernels by the processor's name. One that is newer than it gets
the slowest, and another kernel rounds otherwise.
"""

import functools
import os
import platform
import sys

VARIABLE = "OPENBLAS_CORETYPE"
KERNEL = "Haswell"  # the first with AVX2 and fused multiply-add


@functools.cache
def has_avx2() -> bool:
    """Whether this processor has the instructions of Intel's Haswell; False where the system does not say."""
    if platform.machine() not in ("x86_64", "AMD64"):
        return False
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            flags = next((line for line in file if line.startswith("flags")), "")
    except OSError:
        return False
    return {"avx2", "fma", "bmi2"} <= set(flags.split())


def choose_blas_kernel() -> None:
    """Name OpenBLAS its kernel, in this process and those that it starts.

    Nothing is done where the user named one, on a processor without AVX2, or once NumPy is there, which has
    chosen then.
    """
    if "numpy" not in sys.modules and VARIABLE not in os.environ and has_avx2():
        os.environ[VARIABLE] = KERNEL
