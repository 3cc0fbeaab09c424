"""Names of docs/api.md: where they are imported from, and that rooms import them when they are asked for."""

import ast
import importlib
import re
from pathlib import Path

import pytest

from tests.test_imports import loaded_by

REPOSITORY = Path(__file__).parents[1]
ROOMS = sorted(
    path.parent.name
    for path in (REPOSITORY / "objectfolder").glob("*/__init__.py")
    if "lazy_names" in path.read_text(encoding="utf-8")
)
DOCUMENTED = re.findall(
    r"^::: ([\w.]+)$", (REPOSITORY / "docs" / "api.md").read_text(encoding="utf-8"), flags=re.MULTILINE
)


def test_every_documented_name_is_exported_near_the_top():
    for path in DOCUMENTED:
        if path == "objectfolder.errors":
            continue
        assert path.count(".") <= 2, path
        package, _, name = path.rpartition(".")
        module = importlib.import_module(package)
        assert name in module.__all__ if package != "objectfolder" else hasattr(module, name), path
        assert getattr(module, name).__name__ == name


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_tells_type_checkers_and_python_the_same(room):
    package = importlib.import_module(f"objectfolder.{room}")
    tree = ast.parse(Path(str(package.__file__)).read_text(encoding="utf-8"))
    checked = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith(f"objectfolder.{room}.")
        for alias in node.names
    }
    assert package.__all__ == sorted(checked)
    for name, module in checked.items():
        assert getattr(package, name) is getattr(importlib.import_module(str(module)), name)
        assert name in dir(package)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        package.nothing  # noqa: B018


def test_importing_rooms_loads_nothing_heavy():
    heavy = {"torch", "scipy", "numba", "zarr", "PIL", "bpy", "dask", "mujoco", "gymnasium", "xarray"}
    rooms = ", ".join(f"objectfolder.{room}" for room in ROOMS)
    assert not heavy & loaded_by(f"import {rooms}")
