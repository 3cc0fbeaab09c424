"""Views as NeRF data: ``transforms*.json`` beside PNG images.

Three readers' layouts share one folder:

``transforms_train.json``, ``transforms_val.json``, ``transforms_test.json``
    Blender-synthetic (Mildenhall et al. 2020): ``camera_angle_x``, and for each frame ``file_path`` without
    suffix and ``transform_matrix``, camera to world in the OpenGL convention. ``pl_pos`` and
    ``pl_intensity`` a frame are the point light as NRHints (Zeng et al. 2023) and GS3 (Bi et al. 2024) read
    it; ``light_position`` is the same under a plain name.
``transforms.json``
    instant-ngp and nerfstudio: ``fl_x``, ``fl_y``, ``cx``, ``cy``, ``w``, ``h``; ``file_path`` with suffix.
    It lists all views, and ``train_filenames``, ``val_filenames``, ``test_filenames`` say which are held out.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.export.files import Credit, write_json
from objectfolder.export.posed_views import PosedViews

# There is no third set. Readers of the Blender-synthetic layout demand one.
VALIDATION_NOTE = "the held-out views again: choose nothing by them that is then scored on the test views"
LIGHT_CONVENTION = (
    "one point light a frame: light_position = pl_pos, frame of the poses; pl_intensity in watts per "
    "steradian: Lambertian radiance = albedo / pi * pl_intensity * cos / distance^2"
)


def write_transforms(folder: Path, views: PosedViews, credit: Credit, *, exr: bool = False) -> list[str]:
    """Write images and camera files of `views` into an existing folder.

    Parameters
    ----------
    exr
        Write scene-linear OpenEXR images, too, named by ``linear_file_path`` of each frame.

    Returns
    -------
    list of str
        The camera files written.
    """
    stems = [_stem(name) for name in views.names]
    views.write_images(folder, folder / "linear" if exr else None, stems)
    intrinsics = {
        "light": LIGHT_CONVENTION,
        "frame": views.described_frame(),
        "object": credit.to_dict(),
        "image": "8-bit sRGB, straight alpha; blend over a background in encoded values",
    }
    files = {}
    for name, is_held_out in (("train", False), ("val", True), ("test", True)):
        rows = np.flatnonzero(views.held_out == is_held_out)
        files[f"transforms_{name}.json"] = {
            "camera_angle_x": camera_angle_x(views),
            **intrinsics,
            **({"validation": VALIDATION_NOTE} if name == "val" else {}),
            "frames": [_frame(views, row, f"./{_stem(views.names[row])}", exr) for row in rows],
        }
    files["transforms.json"] = _with_intrinsics(views, intrinsics, exr)
    for name, content in files.items():
        write_json(folder / name, content)
    return sorted(files)


def camera_angle_x(views: PosedViews) -> float:
    """Return the angle over the width in radians; the product's field of view is over the longer side."""
    return 2.0 * math.atan(views.size[1] / 2.0 / views.focal_length_px)


def _with_intrinsics(views: PosedViews, intrinsics: dict[str, Any], exr: bool) -> dict[str, Any]:
    height, width = views.size
    paths = [f"{_stem(name)}.png" for name in views.names]
    held_out = [path for path, is_held_out in zip(paths, views.held_out, strict=True) if is_held_out]
    return {
        "camera_model": "OPENCV",
        "fl_x": views.focal_length_px,
        "fl_y": views.focal_length_px,
        "cx": width / 2.0,
        "cy": height / 2.0,
        "w": width,
        "h": height,
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
        "camera_angle_x": camera_angle_x(views),
        # instant-ngp takes top-level `scale` and `offset` as its own: the way to metres is under `frame`.
        "aabb_scale": 1,
        **intrinsics,
        "train_filenames": [
            path for path, is_held_out in zip(paths, views.held_out, strict=True) if not is_held_out
        ],
        "val_filenames": held_out,
        "test_filenames": held_out,
        "validation": VALIDATION_NOTE,
        "frames": [_frame(views, row, path, exr) for row, path in enumerate(paths)],
    }


def _frame(views: PosedViews, row: int, file_path: str, exr: bool) -> dict[str, Any]:
    light = views.lights[row].tolist()
    frame: dict[str, Any] = {
        "file_path": file_path,
        "transform_matrix": views.camera_to_object[row].tolist(),
        "light_position": light,
        "pl_pos": light,
        "pl_intensity": [views.light_intensity] * 3,
        "held_out": bool(views.held_out[row]),
    }
    if exr:
        frame["linear_file_path"] = f"./linear/{_stem(views.names[row])}.exr"
    return frame


def _stem(name: str) -> str:
    split, _, index = name.partition("_")
    return f"{split}/r_{index}"
