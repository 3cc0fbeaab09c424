"""Makes numerical libraries use the same instructions on every processor of a vendor.

Each library takes other paths on a newer processor, whose sums differ in the last bits; a fit amplifies
them. With these settings a processor with AVX-512 makes the bytes of one with AVX2 of the same vendor, for
some hundredths of the seconds of the solver of modes. MKL still knows Intel from AMD: what differs between
them is in ``docs/reproducibility.md``. numba's target is set in `objectfolder.jit`, for every process.
"""

import functools
import platform
from collections.abc import Mapping
from pathlib import Path

AVX2: Mapping[str, str] = {
    "ATEN_CPU_CAPABILITY": "avx2",
    "MKL_CBWR": "AVX2",
    "MKL_ENABLE_INSTRUCTIONS": "AVX2",
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL",
    "ONEDNN_MAX_CPU_ISA": "AVX2",
    "OPENBLAS_CORETYPE": "Haswell",
}


@functools.cache
def settings() -> Mapping[str, str]:
    """Return the environment of a task's process; nothing where the processor has no AVX2."""
    if platform.machine() not in ("x86_64", "AMD64"):
        return {}
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="utf-8").partition("\nflags")[2].partition("\n")[0]
    except OSError:
        return {}
    return AVX2 if {"avx2", "fma", "bmi2"} <= set(flags.split()) else {}
