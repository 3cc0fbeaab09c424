"""Views as a COLMAP data set: images, the sparse model, and points that the views truly see."""

from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import project
from objectfolder.vision.export.colmap import (
    SparseModel,
    quaternion,
    world_to_camera,
    write_binary,
    write_text,
)
from objectfolder.vision.export.credit import Credit
from objectfolder.vision.export.folder import write_json
from objectfolder.vision.export.images import straight_srgb, write_exr, write_png
from objectfolder.vision.export.posed_views import PosedViews

# A point is seen where the first hit of its ray is no farther than this before it, in object lengths.
SAME_POINT = 1e-6


def write_colmap(
    folder: Path,
    views: PosedViews,
    credit: Credit,
    surface: Surface | None,
    *,
    points: int = 5000,
    seed: int = 0,
    exr: bool = False,
) -> int:
    """Write ``images/``, ``sparse/0/`` (binary), ``sparse_text/0/`` and ``views.json`` into a folder.

    ``sparse/0/test.txt`` names the held-out images for readers of Gaussian splatting; ``views.json`` has what
    COLMAP has no place for: light, split and the way to metres.

    Parameters
    ----------
    surface
        The surface that was rendered, metres; points are drawn on it. Without it the model has no points.
    points
        How many points to draw; those seen by fewer than two views, or by no training view, are left out.
    seed
        Of the points.

    Returns
    -------
    int
        Points written.

    Raises
    ------
    InputError
        A number of points that is negative.
    """
    if points < 0:
        raise InputError("points", f"{points} is negative", "Give 0 or more.")
    model = sparse_model(views, surface, points=points, seed=seed)
    (folder / "images").mkdir()
    if exr:
        (folder / "linear").mkdir()
    for index, name in enumerate(views.names):
        write_png(folder / "images" / f"{name}.png", views.rgba[index])
        if exr:
            write_exr(folder / "linear" / f"{name}.exr", views.rgba[index])
    write_binary(folder / "sparse" / "0", model)
    write_text(folder / "sparse_text" / "0", model)
    held_out = [name for name, kept in zip(model.names, views.held_out, strict=True) if kept]
    (folder / "sparse" / "0" / "test.txt").write_text("".join(f"{name}\n" for name in held_out))
    write_json(
        folder / "views.json",
        {
            "object": credit.to_dict(),
            "frame": views.described_frame(),
            "points": "surface samples with the views that see them" if len(model.points) else
            "none: the surface was not at hand",
            "light": "a point light an image, frame of the poses; radiant intensity in watts per steradian",
            "light_intensity": views.light_intensity,
            "images": {
                name: {"light_position": light.tolist(), "held_out": bool(kept)}
                for name, light, kept in zip(model.names, views.light_position, views.held_out, strict=True)
            },
        },
    )  # fmt: skip
    return len(model.points)


def sparse_model(views: PosedViews, surface: Surface | None, *, points: int, seed: int) -> SparseModel:
    """Return the model of views, and of points drawn on the surface (metres) with the views that see them.

    Positions are true, not triangulated: an observation is where the point projects, given only where a ray
    from the camera meets the point first and the object covers half of the pixel or more. A point's colour is
    the mean of what training views show there.
    """
    rotation, translation = world_to_camera(views.camera_to_world)
    positions, image, point, at = _observations(views, surface, points, seed)
    colours, trained = _mean_colours(views, len(positions), image, point, at)
    kept = (np.bincount(point, minlength=len(positions)) >= 2) & trained
    renumbered = np.cumsum(kept) - 1
    of_kept = kept[point]
    height, width = views.size
    return SparseModel(
        width, height, views.focal_length_px, quaternion(rotation), translation,
        [f"{name}.png" for name in views.names], positions[kept], colours[kept],
        image[of_kept], renumbered[point[of_kept]], at[of_kept],
    )  # fmt: skip


def _observations(
    views: PosedViews, surface: Surface | None, count: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return points (p, 3) in the views' frame, and of each observation image, point and position."""
    if surface is None or count == 0:
        nothing = np.zeros(0, dtype=np.int64)
        return np.zeros((0, 3)), nothing, nothing, np.zeros((0, 2))
    metric = surface.sample(count, seed).points
    frame = views.unit_frame
    positions = metric if views.frame == "object" else frame.to_unit(metric)
    height, width = views.size
    images, rows, places = [], [], []
    for index, pose in enumerate(views.camera_to_world):
        local = (positions - pose[:3, 3]) @ pose[:3, :3]
        ahead = np.flatnonzero(local[:, 2] < 0)
        at = project(positions[ahead], pose, (height, width), views.field_of_view_deg)
        inside = ((at >= 0) & (at < [width, height])).all(axis=1)
        ahead, at = ahead[inside], at[inside]
        eye = pose[:3, 3] if views.frame == "object" else frame.to_object(pose[:3, 3])
        ray = metric[ahead] - eye
        distance = surface.ray_hits(np.broadcast_to(eye, ray.shape), ray).distance
        seen = np.abs(distance - 1) * np.linalg.norm(ray, axis=1) < SAME_POINT * frame.scale
        # A pixel that the object covers in small part does not show the point.
        column, row = np.floor(at).astype(np.int64).T
        seen &= views.rgba[index, row, column, 3] >= 0.5
        images.append(np.full(np.count_nonzero(seen), index))
        rows.append(ahead[seen])
        places.append(at[seen])
    return positions, np.concatenate(images), np.concatenate(rows), np.concatenate(places)


def _mean_colours(
    views: PosedViews, count: int, image: np.ndarray, point: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean colours (p, 3) uint8 over training views, and whether a training view sees a point (p,)."""
    column, row = np.floor(at).astype(np.int64).T
    rgba = straight_srgb(views.rgba[image, row, column])
    usable = ~views.held_out[image]
    seen = np.bincount(point[usable], minlength=count)
    sums = [np.bincount(point[usable], rgba[usable, channel], count) for channel in range(3)]
    mean = np.stack(sums, axis=1) / np.maximum(seen, 1)[:, None]
    return np.round(mean).astype(np.uint8), seen > 0
