"""The conditions under which `bench.machines` runs the same tasks: one thing changed, or all of a machine."""

from dataclasses import dataclass, field
from pathlib import Path

from pipeline.processes import instructions

# As in children of the factory (`pipeline.processes.isolation`), but for the instructions they are held to.
USUAL = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OMP_WAIT_POLICY": "PASSIVE",
    "PYTHONHASHSEED": "0",
}
TWO = {name: "2" for name in USUAL if name.endswith("THREADS")}
# What the C library takes for exp, sin and pow was chosen before anything could be disguised.
LIBM_FMA = "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512DQ,-AVX512BW"
LIBM_SSE = "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512DQ,-AVX512BW,-AVX2,-AVX,-FMA"
# What tells every library to take the same path on any processor with AVX2.
PINNED = dict(instructions.AVX2)


@dataclass(frozen=True)
class Condition:
    """How a process differs from the factory's.

    Parameters
    ----------
    says
        What is different, in words.
    environment
        Variables added.
    processor
        Disguise of the processor (``machines_disguise.c``), or none.
    times
        Runs in the same process, of which the last counts.
    elsewhere
        Work in another current folder, with another temporary one.
    """

    says: str
    environment: dict[str, str] = field(default_factory=dict)
    processor: str = ""
    times: int = 1
    elsewhere: bool = False

    def variables(self, disguise: Path, compiled: Path) -> dict[str, str]:
        """Return the environment; `disguise` is the library, `compiled` the folder of numba's cache."""
        variables = {**USUAL, **self.environment}
        if self.processor:
            variables |= {"LD_PRELOAD": str(disguise), "OBJECTFOLDER_DISGUISE": self.processor}
        if self.processor or "NUMBA_CPU_NAME" in variables:
            variables["NUMBA_CACHE_DIR"] = str(compiled)
        return variables


CONDITIONS = {
    "again": Condition("nothing: a second process"),
    "recycled": Condition("a child that ran the same tasks before", times=2),
    "surroundings": Condition(
        "hash seed, locale, time zone, current and temporary folder",
        {"PYTHONHASHSEED": "77", "LC_ALL": "C", "LANG": "de_DE.UTF-8", "TZ": "Pacific/Auckland"},
        elsewhere=True,
    ),
    "two threads": Condition("OpenMP, OpenBLAS, MKL, numba and torch with two threads", TWO),
    "NumPy without AVX512": Condition(
        "paths of NumPy", {"NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL "
                           "AVX512_ICL AVX512_SPR"}
    ),
    "NumPy without AVX2": Condition(
        "paths of NumPy", {"NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX "
                           "AVX512_CNL AVX512_ICL AVX512_SPR"}
    ),
    "OpenBLAS Haswell": Condition("kernels of OpenBLAS", {"OPENBLAS_CORETYPE": "Haswell"}),
    "OpenBLAS Nehalem": Condition("kernels of OpenBLAS", {"OPENBLAS_CORETYPE": "Nehalem"}),
    "MKL AVX2": Condition(
        "paths of MKL, torch's too", {"MKL_ENABLE_INSTRUCTIONS": "AVX2", "MKL_CBWR": "AVX2"}
    ),
    "MKL compatible": Condition("paths of MKL, torch's too", {"MKL_CBWR": "COMPATIBLE"}),
    "torch AVX2": Condition("kernels of torch", {"ATEN_CPU_CAPABILITY": "avx2"}),
    "torch default": Condition("kernels of torch", {"ATEN_CPU_CAPABILITY": "default"}),
    "numba generic": Condition(
        "kernels compiled by numba", {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    ),
    "libm without FMA": Condition("exp, sin, pow of the C library", {"GLIBC_TUNABLES": LIBM_SSE}),
    "Skylake-X": Condition("a server of 2017: AVX-512", processor="skylakex"),
    "Haswell": Condition("a computer of 2013: AVX2", {"GLIBC_TUNABLES": LIBM_FMA}, "haswell"),
    "Zen 2": Condition("an AMD of 2019: AVX2", {"GLIBC_TUNABLES": LIBM_FMA}, "zen2"),
    "Nehalem": Condition("a computer of 2008: SSE4.2", {"GLIBC_TUNABLES": LIBM_SSE}, "nehalem"),
    "pinned": Condition("every library told to go no further than AVX2", PINNED),
    "pinned Haswell": Condition("the same on a Haswell", {**PINNED, "GLIBC_TUNABLES": LIBM_FMA}, "haswell"),
    "pinned Zen 2": Condition("the same on a Zen 2", {**PINNED, "GLIBC_TUNABLES": LIBM_FMA}, "zen2"),
}  # fmt: skip
MACHINES = ("Skylake-X", "Haswell", "Zen 2", "Nehalem")
