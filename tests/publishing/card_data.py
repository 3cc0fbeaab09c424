"""A data set with reports, written by the pipeline's own writers, for tests of the cards."""

from pathlib import Path

import numpy as np

from objectfolder.products.store import Array, Product, write_product
from objectfolder.products.tensor_file import TensorFile, write_tensor_file
from pipeline.dataset.records import Records, write_records
from pipeline.dataset.stages import FIDELITY, OBJECT_FILES
from pipeline.dataset.task import Failure
from pipeline.publish.report.report import write_report

REPOSITORY = Path(__file__).parents[2]


def row(name: str, licence: str = "CC0-1.0", attribution: str = "A. Maker", source: str = "scans") -> dict:
    """What data/records.json holds of an object."""
    return {
        "name": name,
        "material": {"name": "steel"},
        "material_citation": "a book",
        "loss_citation": "another book",
        "roughness_um": 0.8,
        "appearance": {"roughness": 0.4, "metallic": 1.0},
        "walls": {"wall_m": None, "shell_m": None},
        "senses": ["vision", "audio", "touch"],
        "source": source,
        "licence": licence,
        "attribution": attribution,
        "mass_kg": None,
    }


def write_data_set(
    root: Path, rows: dict[str, dict], ids: set[str] | None = None, refused: tuple = ()
) -> Path:
    """Write a data set (objects not in `ids` have no products), and its report into the folder returned."""
    (root / "params.yaml").write_text((REPOSITORY / "params.yaml").read_text())
    write_records(root, Records(rows, tuple(Failure(*entry) for entry in refused)))
    for index, object_id in enumerate(sorted(rows)):
        if ids is not None and object_id not in ids:
            continue
        tensors = {"surface.positions": np.full(64, index, np.int32)}
        path = OBJECT_FILES.path(root, object_id)
        write_tensor_file(path, TensorFile(tensors, {"format": "objectfolder"}))
        picture = Array(np.zeros((1, 8, 8, 3), np.uint8), ("picture", "y", "x", "channel"), "1", "a picture")
        fidelity = {
            "object": {"id": object_id, "name": rows[object_id]["name"], "material": "steel"},
            "vision": {"psnr_db": 50.0 + index, "psnr_foreground_db": 40.0, "ssim": 0.99, "per_view": []},
            "audio": {"audible": False, "modes": 0, "gain_error_db": None},
            "touch": {"psnr_db": 55.0, "psnr_contact_db": 50.0},
            "bytes": {"total": path.stat().st_size},
            "definitions": {"vision.psnr_db": "PSNR of |images| on white"},
        }
        arrays = dict.fromkeys(("vision_truth", "vision_answer", "touch_truth", "touch_answer"), picture)
        write_product(FIDELITY.path(root, object_id), Product(arrays, fidelity))
    write_report(root / FIDELITY.folder, root / "costs.csv", root / "reports")
    return root / "reports"
