"""Shared fixtures."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from objectfolder.making.touches.record import simulate_touches
from objectfolder.products.store import read_product, write_product
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.touch.sensor.sensor import Sensor

# The servers that tests of the pipeline stand up are modules of its folder.
sys.path.append(str(Path(__file__).parents[1] / "pipeline"))


@pytest.fixture(scope="session")
def small_set(
    glass_bar: TexturedMesh, small_file: Path, make_once: Callable[[str, Callable[[Path], None]], Path]
) -> Path:
    """Root of a data set of two objects, the bar of `small_file` twice, with its truth and more touches."""
    return make_once("set", lambda root: _make_set(glass_bar, small_file, root))


def _make_set(glass_bar: TexturedMesh, small_file: Path, root: Path) -> None:
    products = {kind: read_product(small_file.with_name(f"{kind}.zarr.zip")) for kind in ("views", "modes")}
    products["touches"] = simulate_touches(glass_bar.surface, Sensor(), touches=3, held_out_touches=6, seed=0)
    for object_id in ("bar", "rod"):
        for kind, product in products.items():
            write_product(root / "data" / kind / f"{object_id}.zarr.zip", product)
        path = root / "data" / "object_files" / f"{object_id}.safetensors"
        path.parent.mkdir(exist_ok=True)
        shutil.copy(small_file, path)
    records = {object_id: {"material": {"name": "glass"}} for object_id in ("bar", "rod")}
    (root / "data" / "records.json").write_text(json.dumps({"objects": records, "refused": []}))
