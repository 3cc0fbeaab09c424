"""The examples of the public interface, run as they stand in the docstrings."""

import inspect
import shutil
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import pytest
import trimesh

from objectfolder.object_file import ObjectFile
from objectfolder.surface.textured_mesh import TexturedMesh
from tests.docstring_examples import run_example
from tests.test_public_names import DOCUMENTED, named_by

REPOSITORY = Path(__file__).parents[1]


def public() -> dict[str, Callable[..., Any]]:
    """The functions of the reference, its classes with an example, and the methods of an Object File."""
    named = {path: named_by(path) for path in DOCUMENTED}
    for path, module in list(named.items()):
        named |= {f"{path}.{name}": getattr(module, name) for name in getattr(module, "__all__", ())}
    methods = inspect.getmembers(ObjectFile, inspect.isroutine)
    named |= {
        f"ObjectFile.{name}": method
        for name, method in methods
        if not name.startswith("_") and not isinstance(method, cached_property)
    }
    return {
        path: value
        for path, value in named.items()
        if inspect.isroutine(value) or (inspect.isclass(value) and ">>>" in str(value.__doc__))
    }


PUBLIC = public()
SLOW = (
    "objectfolder.making.simulate_modes", "objectfolder.fidelity.verify_object",
    "objectfolder.making.simulate_views",
)  # fmt: skip


@pytest.fixture(scope="module")
def examples(small_file: Path, glass_bar: TexturedMesh, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that docs/api.md describes: a bar's Object File, mesh and truth, and the materials."""
    folder = tmp_path_factory.mktemp("examples")
    for path in sorted(small_file.parent.iterdir()):
        shutil.copy(path, folder)
    shutil.copy(REPOSITORY / "data" / "materials.csv", folder)
    trimesh.Trimesh(glass_bar.vertices, glass_bar.faces, process=False).export(folder / "bar.obj")
    return folder


# Those of objectfolder.batch run in tests/batch, in a process that compiles its bodies.
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name
        for name in sorted(PUBLIC)
        if ".batch." not in name
    ],
)
def test_example_yields_what_it_says(name, examples, monkeypatch):
    monkeypatch.chdir(examples)
    run_example(name, PUBLIC[name])
