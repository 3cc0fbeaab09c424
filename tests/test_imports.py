"""Who may import whom: the arrows point one way."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
SENSES = ("vision", "audio", "touch")
# The border modules, and what only they may import, inside functions.
BORDERS = {
    "bpy": {"objectfolder.vision.cycles"},
    "mathutils": {"objectfolder.vision.cycles"},
    "OpenGL": {"objectfolder.touch.pyrender_reference"},
    "pyrender": {"objectfolder.touch.pyrender_reference"},
}
PIPELINE_ONLY = ("dask", "distributed", "dvc", "pipeline")
ALLOWED_AT_TOP = frozenset({"numpy", "torch", "objectfolder"}) | sys.stdlib_module_names


def modules(package: str) -> dict[str, ast.Module]:
    found = {}
    for path in sorted((REPOSITORY / package).rglob("*.py")):
        name = ".".join(path.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__")
        found[name] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def imported(node: ast.AST, package: str) -> list[str]:
    """Full dotted names that an import statement brings in; ``from a import b`` gives ``a.b``."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        origin = node.module or ""
        if node.level:
            parts = package.split(".")
            origin = ".".join([*parts[: len(parts) - node.level + 1], *filter(None, [origin])])
        return [f"{origin}.{alias.name}" for alias in node.names]
    return []


def imports(tree: ast.AST, package: str, anywhere: bool = True) -> list[str]:
    """Names imported in a module: anywhere, or only when the module itself is imported."""
    if anywhere:
        return [name for node in ast.walk(tree) for name in imported(node, package)]
    names: list[str] = []
    pending = list(ast.iter_child_nodes(tree))
    while pending:
        node = pending.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            pending.extend(node.orelse)
            continue
        names.extend(imported(node, package))
        pending.extend(ast.iter_child_nodes(node))
    return names


LIBRARY = modules("objectfolder")
PIPELINE = modules("pipeline")


def package_of(name: str, tree: dict[str, ast.Module]) -> str:
    return name if any(other.startswith(f"{name}.") for other in tree) else name.rpartition(".")[0]


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


@pytest.mark.parametrize("name", LIBRARY)
def test_library_imports_neither_pipeline_nor_what_belongs_to_it(name):
    for found in imports(LIBRARY[name], package_of(name, LIBRARY)):
        assert found.split(".")[0] not in PIPELINE_ONLY, f"{name} imports {found}"


@pytest.mark.parametrize("name", [*LIBRARY, *PIPELINE])
def test_borders_alone_import_blender_and_opengl_inside_functions(name):
    everything = LIBRARY | PIPELINE
    package = package_of(name, everything)
    for found in imports(everything[name], package):
        assert name in BORDERS.get(found.split(".")[0], {name}), f"{name} imports {found}"
    for found in imports(everything[name], package, anywhere=False):
        assert found.split(".")[0] not in BORDERS, f"{name} imports {found} when it is imported"


@pytest.mark.parametrize("name", LIBRARY)
def test_senses_and_geometry_stand_apart(name):
    own = name.split(".")[1] if "." in name else ""
    if own not in (*SENSES, "geometry"):
        return
    forbidden = [sense for sense in (*SENSES, "fidelity") if sense != own]
    for found in imports(LIBRARY[name], package_of(name, LIBRARY)):
        for other in forbidden:
            assert not within(found, f"objectfolder.{other}"), f"{name} imports {found}"
        assert not within(found, "objectfolder.object_file"), f"{name} imports {found}"


@pytest.mark.parametrize("name", [name for name in PIPELINE if within(name, "pipeline.tasks")])
def test_tasks_know_nothing_of_the_framework(name):
    for found in imports(PIPELINE[name], package_of(name, PIPELINE)):
        if within(found, "pipeline"):
            assert within(found, "pipeline.dataset.task") or within(found, "pipeline.tasks"), (
                f"{name} imports {found}"
            )


@pytest.mark.parametrize("name", PIPELINE)
def test_dask_is_imported_by_clusters_alone(name):
    for found in imports(PIPELINE[name], package_of(name, PIPELINE)):
        if found.split(".")[0] in ("dask", "distributed"):
            assert name.startswith("pipeline.cluster."), f"{name} imports {found}"


def test_queries_import_numpy_and_torch_alone():
    """Everything that opening and asking an Object File imports, followed through the source."""
    seen: set[str] = set()
    pending = ["objectfolder", "objectfolder.object_file"]
    while pending:
        name = pending.pop()
        if name in seen:
            continue
        seen.add(name)
        for found in imports(LIBRARY[name], package_of(name, LIBRARY), anywhere=False):
            assert found.split(".")[0] in ALLOWED_AT_TOP, f"{name} imports {found} when it is imported"
            pending.extend(other for other in (found, found.rpartition(".")[0]) if other in LIBRARY)


def test_importing_the_library_loads_nothing_heavy():
    script = "import sys, objectfolder; print(*{name.split('.')[0] for name in sys.modules})"
    loaded = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=REPOSITORY
    ).stdout.split()
    heavy = {"torch", "scipy", "zarr", "trimesh", "bpy", "dask", "distributed", "dvc", "numba", "pandas"}
    assert not heavy & set(loaded)
