"""Names of docs/api/: where they are imported from, and that rooms import them when they are asked for."""

import ast
import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest

from objectfolder.touch import Touches
from tests.test_imports import loaded_by

REPOSITORY = Path(__file__).parents[1]
ROOMS = sorted(
    path.parent.name
    for path in (REPOSITORY / "objectfolder").glob("*/__init__.py")
    if "lazy_names" in path.read_text(encoding="utf-8")
)
DOCUMENTED = [
    name
    for page in sorted((REPOSITORY / "docs" / "api").glob("*.md"))
    for name in re.findall(r"^::: ([\w.]+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
]


def named_by(path: str) -> Any:
    """Return what a dotted path of the reference names: part of a module, or a module."""
    module, _, name = path.rpartition(".")
    try:
        return getattr(importlib.import_module(module), name)
    except AttributeError:
        return importlib.import_module(path)


def test_every_documented_name_is_exported_near_the_top():
    assert len(DOCUMENTED) == len(set(DOCUMENTED))
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


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("objectfolder.audio.simulate_modes", "objectfolder.making.simulate_modes"),
        ("objectfolder.mesh.load_mesh", "objectfolder.making.load_mesh"),
        ("objectfolder.mesh.TexturedMesh", "objectfolder.surface.TexturedMesh"),
    ],
)
def test_a_name_that_moved_works_where_it_was_and_warns(old, new):
    warning = rf"{old} is now `{new}`; the old name goes with 0\.3"
    with pytest.warns(DeprecationWarning, match=warning) as caught:
        assert named_by(old) is named_by(new)
    assert {caution.filename for caution in caught} == {__file__}


def test_importing_rooms_loads_nothing_heavy():
    heavy = {"torch", "scipy", "numba", "zarr", "PIL", "bpy", "dask", "mujoco", "gymnasium", "xarray"}
    rooms = ", ".join(f"objectfolder.{room}" for room in ROOMS)
    assert not heavy & loaded_by(f"import {rooms}")


# What a unit, or a frame, belongs to the name of.
BARE = {
    "duration", "time", "depth", "force", "forces", "impulse", "impulses", "tilt", "azimuth", "roll", "mass",
    "length", "radius", "distance", "speed", "sample_rate", "field_of_view", "camera_to_world", "light",
    "light_position", "light_positions", "light_colour", "light_colours", "lamps_m", "lamp_colours",
    "color", "colors",
}  # fmt: skip

# Made by the library alone: nobody writes their arguments.
RESULTS = {"objectfolder.audio.ObjectStream", "objectfolder.touch.Touches"}
# Encoders call these with all parts of an Object File.
ENCODING = {
    "objectfolder.object_file.ObjectFile.__init__",
    "objectfolder.object_file.ObjectFile.of_encoders",
    "objectfolder.making.encode_object",
}


def public_calls() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Functions of the reference, and how its classes are made and asked."""
    for path in DOCUMENTED:
        if path in RESULTS:
            continue
        documented = named_by(path)
        if inspect.isfunction(documented):
            yield path, documented
        elif inspect.isclass(documented):
            for method, function in inspect.getmembers(documented, inspect.isroutine):
                own = (getattr(function, "__module__", None) or "").startswith("objectfolder.")
                if own and (method == "__init__" or not method.startswith("_")):
                    yield f"{path}.{method}", function


def test_public_parameters_state_units_frames_and_lights_in_one_way():
    calls = dict(public_calls())
    assert len(calls) > 60
    for path, function in calls.items():
        for name in inspect.signature(function).parameters:
            in_world = path.startswith("objectfolder.live.") and name == "camera_to_world"
            assert name not in BARE or in_world, f"{path}({name})"


def test_fields_of_results_state_units():
    for path in sorted(RESULTS):
        documented = named_by(path)
        names = [field.name for field in fields(documented)] if is_dataclass(documented) else []
        assert not BARE & set(names), path
    assert "depth_m" in [field.name for field in fields(Touches)]


def test_public_functions_take_four_arguments_by_position_at_most():
    by_position = {inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD}
    for path, function in public_calls():
        owner = path.removesuffix(".__init__")
        if path in ENCODING or (owner != path and is_record(named_by(owner))):
            continue
        names = [p.name for p in inspect.signature(function).parameters.values() if p.kind in by_position]
        assert len([name for name in names if name != "self"]) <= 4, f"{path}({', '.join(names)})"


def is_record(documented: type) -> bool:
    return is_dataclass(documented) or hasattr(documented, "_fields")
