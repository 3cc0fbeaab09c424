"""Who may import whom, where the contracts of ``.importlinter``, which `make lint` checks, cannot say it."""

import ast
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
BORDERS = {
    "objectfolder/making/views/cycles.py": "bpy",
    "objectfolder/making/mesh/readers/blender_process.py": "bpy",
    "pipeline/run/decimation_process.py": "bpy",
    "objectfolder/making/touches/opengl.py": "pyrender",
}


def test_border_modules_import_blender_and_opengl_inside_functions():
    for path, package in BORDERS.items():
        tree = ast.parse((REPOSITORY / path).read_text(encoding="utf-8"))
        at_top = ast.unparse([node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)])
        inside = ast.unparse([node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)])
        assert f"import {package}" in inside
        assert package not in at_top


def modules_loaded_by(statement: str) -> set[str]:
    script = f"import sys\n{statement}\nprint(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=REPOSITORY
    )
    return set(done.stdout.split())


def loaded_by(statement: str) -> set[str]:
    return {name.partition(".")[0] for name in modules_loaded_by(statement)}


def test_opening_and_asking_an_object_file_imports_the_core_alone(small_file):
    ask = f"import objectfolder; objectfolder.load({str(small_file)!r})"
    own = {"objectfolder"} | loaded_by("import numpy, numba, scipy")
    assert loaded_by(ask) - own - sys.stdlib_module_names == set()


def test_opening_an_object_file_loads_no_queries(small_file):
    loaded = modules_loaded_by(f"import objectfolder; objectfolder.load({str(small_file)!r})")
    assert not {"numba", "scipy"} & loaded
    own = [name for name in loaded if name.startswith("objectfolder.")]
    packages = [name for name in own if any(module.startswith(f"{name}.") for module in own)]
    assert 30 < len(own) - len(packages) <= 60


def test_importing_the_library_loads_nothing_heavy():
    heavy = {"torch", "scipy", "zarr", "trimesh", "bpy", "dask", "distributed", "dvc", "numba", "pandas"}
    assert not heavy & loaded_by("import objectfolder")
