"""Commands, notebooks, tests and tasks take the same kernels of OpenBLAS, unless the user named others."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from objectfolder import instructions

needs_avx2 = pytest.mark.skipif(not instructions.has_avx2(), reason="a processor without AVX2")


@pytest.mark.parametrize(
    ("processor", "named", "loaded", "chosen"),
    [
        (True, None, False, "Haswell"),
        (True, "Zen", False, "Zen"),
        (True, None, True, None),
        (False, None, False, None),
    ],
)
def test_a_kernel_is_chosen_once(
    processor: bool, named: str | None, loaded: bool, chosen: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(instructions, "has_avx2", lambda: processor)
    monkeypatch.delenv("OPENBLAS_CORETYPE", raising=False)
    if named:
        monkeypatch.setenv("OPENBLAS_CORETYPE", named)
    if not loaded:
        monkeypatch.delitem(sys.modules, "numpy")
    instructions.choose_blas_kernel()
    assert os.environ.get("OPENBLAS_CORETYPE") == chosen


@needs_avx2
@pytest.mark.parametrize("package", ["objectfolder", "pipeline", "learning", "bench"])
def test_a_package_chooses_before_numpy_is_there(package: str) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_CORETYPE"}
    script = f"import os, {package}; print(os.environ['OPENBLAS_CORETYPE'])"
    command = [sys.executable, "-c", script]
    assert subprocess.check_output(command, env=environment, text=True) == "Haswell\n"


@needs_avx2
@pytest.mark.skipif(os.environ.get("OPENBLAS_CORETYPE") != "Haswell", reason="the user named another kernel")
def test_tests_have_the_kernel_that_is_named() -> None:
    folder = str(Path(np.__file__).parents[1] / "numpy")  # and its libraries, in a folder beside it
    blas = [entry["architecture"] for entry in threadpool_info() if entry["filepath"].startswith(folder)]
    assert blas == ["Haswell"]
