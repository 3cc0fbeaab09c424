"""Solved bodies, kept between runs."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
import solved_bodies
import structured_solids

from objectfolder.products.store import Product, read_product, write_product
from tests.cache_key import cache_key

PACKAGES = ("embreex", "mkl", "numba", "numpy", "pypardiso", "pytetwild", "scipy", "trimesh")


@pytest.fixture(scope="session")
def solved(make_once: Callable[..., Path]) -> Callable[[str], Product]:
    """A function that returns the modes of a body of `solved_bodies.SOLUTIONS`, by name."""
    solving = ("objectfolder.making.modes.modes", "objectfolder.products.store")
    bodies = [Path(str(each.__file__)) for each in (solved_bodies, structured_solids)]
    inputs = cache_key(solving, bodies, PACKAGES)

    @cache
    def modes_of(name: str) -> Product:
        def solve(folder: Path) -> None:
            write_product(folder / "modes.zarr.zip", solved_bodies.SOLUTIONS[name]())

        folder = make_once(f"solved-{name.replace(' ', '-')}", solve, inputs)
        return read_product(folder / "modes.zarr.zip")

    return modes_of
