"""Rendered truth against an Object File away from a data set's own views: `vision.truth.conditions`."""

import numpy as np

from objectfolder.fidelity.sight import foreground_alpha, measure_within
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.store import Product
from objectfolder.vision.compositing import on_white
from objectfolder.vision.conditions import CONDITIONS

CONDITION_DEFINITIONS = {
    "vision.psnr_CONDITION_db": (
        "PSNR of the foreground in parts of views in other conditions: finer images (128_px the same at the "
        "resolution and distance of the lamp that the others share), lamps at .6 and 3 of the distance, "
        "environments; mean of views"
    ),
    "vision.noise_floor_CONDITION_db": "What the noise of the truth leaves of this PSNR at most",
    "vision.trivial_psnr_CONDITION_db": "PSNR of the true silhouettes filled with the truth's mean colour",
}


def measure_conditions(file: ObjectFile, views: Product) -> dict[str, float]:
    """Compare a file with the views of other conditions, if the product has some.

    Returns
    -------
    dict
        ``psnr_CONDITION_db``, ``trivial_psnr_CONDITION_db`` and ``noise_floor_CONDITION_db`` of each
        condition in whose views the object is seen.
    """
    conditions = views.attributes.get("conditions", {})
    measured: dict[str, float] = {}
    if not conditions:
        return measured
    rgba = views["condition_rgba"].astype(np.float32)
    count = len(rgba) // len(conditions)
    # Whatever the order in which attributes were read back.
    names = [name for name in CONDITIONS if name in conditions]
    for index, name in enumerate(names):
        condition = conditions[name]
        rows = slice(index * count, (index + 1) * count)
        truth, within = on_white(rgba[rows]), rgba[rows, ..., 3] >= foreground_alpha(views)
        if not within.any():
            continue
        answer = _answer(file, views, rows, condition)
        measured[f"psnr_{name}_db"] = float(np.mean(measure_within(truth, within, answer)))
        trivial = on_white(_filled(rgba[rows]))
        measured[f"trivial_psnr_{name}_db"] = float(np.mean(measure_within(truth, within, trivial)))
        measured[f"noise_floor_{name}_db"] = condition["noise_floor_db"]
    return measured


def _answer(file: ObjectFile, views: Product, rows: slice, condition: dict[str, object]) -> np.ndarray:
    """Return the parts (n, h, w, 3) uint8 on white of the views of a condition."""
    cameras = file.frame.camera_to_object(views["condition_camera_to_world"][rows])
    lamps = file.frame.to_object(views["condition_light_position"][rows])
    around = condition["environment"]
    parts = [
        file.render(
            camera,
            lamp if around is None else str(around),
            resolution=int(str(condition["resolution_px"])),
            field_of_view_deg=float(views.attributes["field_of_view_deg"]),
            crop=tuple(part.tolist()),
        )
        for camera, lamp, part in zip(cameras, lamps, views["condition_part"][rows], strict=True)
    ]
    return np.concatenate(parts)


def _filled(rgba: np.ndarray) -> np.ndarray:
    """Return views (n, h, w, 4) with their silhouettes in the mean colour."""
    alpha = rgba[..., 3:].astype(np.float64)
    colour = rgba[..., :3].sum(axis=(0, 1, 2), dtype=np.float64) / max(alpha.sum(), 1e-12)
    return np.concatenate([colour * alpha, alpha], axis=-1)
