"""Optional packages: what works without them, and that a missing one names the extra that brings it."""

import ast
import importlib
import re
import sys
import tomllib
from pathlib import Path

import pytest

from objectfolder.dataset import export_samples, open_xarray
from objectfolder.errors import MissingPackageError
from objectfolder.extras import needs_extra

REPOSITORY = Path(__file__).parents[1]
EXTRAS = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "optional-dependencies"
]

DISTRIBUTIONS = {  # that are not named as what is imported
    "PIL": "Pillow",
    "numba_cuda": "numba-cuda",
    "cv2": "opencv-contrib-python-headless",
    "collada": "pycollada",
    "pxr": "usd-core",
    "skimage": "scikit-image",
    "yaml": "PyYAML",
}


def test_samples_are_exported_and_products_opened_without_torch(small_file, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    for module in [name for name in sys.modules if name.startswith("objectfolder.dataset")]:
        monkeypatch.delitem(sys.modules, module)
    assert export_samples([small_file], tmp_path / "touches", "touch", source="object_file", queries=2) == {
        "train": 2,
        "test": 2,
    }
    assert open_xarray(small_file.parent / "modes.zarr.zip").sizes["mode"] > 0
    with pytest.raises(MissingPackageError, match=r'torch: .*pip install "objectfolder-factory\[dataset\]"'):
        importlib.import_module("objectfolder.dataset").ObjectFolderDataset  # noqa: B018


def test_a_package_that_breaks_says_why_and_a_defect_of_ours_stays_what_it_is(tmp_path, monkeypatch):
    (tmp_path / "broken_package.py").write_text("import no_such_library_of_the_system\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with (
        pytest.raises(MissingPackageError, match="no_such_library_of_the_system: is not installed"),
        needs_extra("video"),
    ):
        import broken_package  # noqa: F401
    with pytest.raises(ModuleNotFoundError) as raised, needs_extra("video"):
        import objectfolder.no_such_module  # noqa: F401
    assert not isinstance(raised.value, MissingPackageError)


def uses(tree: ast.AST) -> list[tuple[str, str]]:
    """Extras and the packages that are imported under their names."""
    pairs = []
    for node in ast.walk(tree):
        if isinstance(node, ast.With) and "needs_extra" in ast.unparse(node.items[0]):
            extra = node.items[0].context_expr.args[0]
            if not isinstance(extra, ast.Constant):  # of the project's own factory
                continue
            for line in node.body:
                names = [line.module] if isinstance(line, ast.ImportFrom) else [a.name for a in line.names]
                pairs += [(extra.value, name.partition(".")[0]) for name in names]
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "missing_package":
            package, extra = node.args[:2]
            if isinstance(package, ast.Constant) and isinstance(extra, ast.Constant):
                pairs.append((extra.value, package.value))
    return pairs


def test_every_named_extra_brings_the_package():
    texts = [
        path.read_text(encoding="utf-8")
        for room in ("objectfolder", "pipeline")
        for path in (REPOSITORY / room).rglob("*.py")
    ]
    named = {
        use
        for text in texts
        if "needs_extra(" in text or "missing_package(" in text
        for use in uses(ast.parse(text))
    }
    assert len(named) >= 12
    for extra, package in sorted(named):
        brought = {re.split(r"[^\w.-]", requirement)[0].lower() for requirement in EXTRAS[extra]}
        assert DISTRIBUTIONS.get(package, package).lower() in brought, f"{extra} does not bring {package}"
