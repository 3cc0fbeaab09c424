"""Solved bodies, kept between runs."""

import os
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
import solved_bodies
import structured_solids

from objectfolder.products.provenance import code_identity, file_digest, package_versions
from objectfolder.products.store import Product, read_product, write_product

PACKAGES = ("embreex", "mkl", "numba", "numpy", "pypardiso", "pytetwild", "scipy", "trimesh")
# A processor's instructions decide roundings, as the user may.
KERNELS = ("OPENBLAS_CORETYPE", "MKL_CBWR", "MKL_ENABLE_INSTRUCTIONS", "NPY_DISABLE_CPU_FEATURES")


@pytest.fixture(scope="session")
def solved(make_once: Callable[..., Path]) -> Callable[[str], Product]:
    """A function that returns the modes of a body of `solved_bodies.SOLUTIONS`, by name."""
    inputs = {
        "code": code_identity("objectfolder.audio.modes.modes")
        | code_identity("objectfolder.products.store"),
        "bodies": [file_digest(Path(str(each.__file__))) for each in (solved_bodies, structured_solids)],
        "packages": package_versions(PACKAGES),
        "kernels": {name: os.environ.get(name) for name in KERNELS},
    }

    @cache
    def modes_of(name: str) -> Product:
        def solve(folder: Path) -> None:
            write_product(folder / "modes.zarr.zip", solved_bodies.SOLUTIONS[name]())

        folder = make_once(f"solved-{name.replace(' ', '-')}", solve, inputs)
        return read_product(folder / "modes.zarr.zip")

    return modes_of
