"""Views as a COLMAP data set: images, the sparse model as text and as binary, and points truly seen.

The formats are those of https://colmap.github.io/format.html: PINHOLE cameras; world to camera as a
Hamilton quaternion (w, x, y, z) and a translation, in a camera frame with x right, y down, z ahead; pixel
positions from the corner of the top left pixel, whose centre is (0.5, 0.5).
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from objectfolder.errors import InputError
from objectfolder.export.files import Credit, straight_srgb, write_json
from objectfolder.export.posed_views import PosedViews
from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import project

CAMERA_ID = 1
# COLMAP's number of the PINHOLE model.
PINHOLE = 1
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0])
# A point is seen where the first hit of its ray is no farther than this before it, in object lengths.
SAME_POINT = 1e-6


@dataclass(frozen=True)
class SparseModel:
    """Images of one pinhole camera, and points they observe.

    Ids of images and points are their rows plus one.

    Parameters
    ----------
    width, height
        Pixels.
    focal_length_px
        Of both axes; the principal point is the middle.
    quaternions
        (n, 4) w, x, y, z, world to camera.
    translations
        (n, 3), world to camera.
    names
        n file names relative to the folder of images.
    points
        (p, 3) positions in the world.
    colours
        (p, 3) uint8 sRGB.
    observed_image, observed_point
        (m,) rows of the image and the point of each observation.
    observed_at
        (m, 2) pixel position of each observation.
    """

    width: int
    height: int
    focal_length_px: float
    quaternions: np.ndarray
    translations: np.ndarray
    names: Sequence[str]
    points: np.ndarray
    colours: np.ndarray
    observed_image: np.ndarray
    observed_point: np.ndarray
    observed_at: np.ndarray

    def intrinsics(self) -> tuple[float, float, float, float]:
        """Return both focal lengths and the principal point in pixels."""
        focal = float(self.focal_length_px)
        return focal, focal, self.width / 2, self.height / 2

    def observations(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Return what each image and what each point has observed.

        Of an image the records (k,) of pixel position ``at`` and id of the ``point``; of a point the rows
        (k, 2) of image id and index in that image.
        """
        records = np.empty(len(self.observed_at), dtype=[("at", "<f8", 2), ("point", "<u8")])
        records["at"], records["point"] = self.observed_at, self.observed_point + 1
        order = np.argsort(self.observed_image, kind="stable")
        starts = np.searchsorted(self.observed_image[order], np.arange(len(self.names) + 1))
        index = np.empty(len(order), dtype=np.int64)
        index[order] = np.arange(len(order)) - starts[self.observed_image[order]]
        by_point = np.argsort(self.observed_point, kind="stable")
        pairs = np.stack([self.observed_image + 1, index], axis=1)[by_point]
        ends = np.searchsorted(self.observed_point[by_point], np.arange(len(self.points) + 1))
        return (
            [records[order[first:last]] for first, last in pairwise(starts)],
            [pairs[first:last] for first, last in pairwise(ends)],
        )


def world_to_camera(camera_to_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (n, 3, 3) and translations (n, 3), world to camera, of (n, 4, 4) OpenGL poses."""
    rotation = OPENGL_TO_OPENCV @ camera_to_world[:, :3, :3].transpose(0, 2, 1)
    return rotation, -np.einsum("nij,nj->ni", rotation, camera_to_world[:, :3, 3])


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return (n, 4) unit Hamilton quaternions w, x, y, z, w >= 0, of (n, 3, 3) rotations."""
    xyzw = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return np.roll(xyzw, 1, axis=1)


def write_colmap(
    folder: Path, views: PosedViews, credit: Credit, surface: Surface | None, *,
    points: int = 5000, seed: int = 0, exr: bool = False,
) -> int:  # fmt: skip
    """Write ``images/``, ``sparse/0/`` (binary), ``sparse_text/0/`` and ``views.json`` into a folder.

    ``sparse/0/test.txt`` names the held-out images for readers of Gaussian splatting; ``views.json`` has what
    COLMAP has no place for: light, split and the way to metres.

    Parameters
    ----------
    surface
        The surface that was rendered, metres; points are drawn on it. Without it the model has no points.
    points, seed
        How many points to draw, and their seed; those seen by fewer than two views, or by no training view,
        are left out.

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
    views.write_images(folder / "images", folder / "linear" if exr else None, views.names)
    write_binary(folder / "sparse" / "0", model)
    write_text(folder / "sparse_text" / "0", model)
    held_out = [name for name, is_held_out in zip(model.names, views.held_out, strict=True) if is_held_out]
    (folder / "sparse" / "0" / "test.txt").write_text("".join(f"{name}\n" for name in held_out))
    origin = "surface samples with the views that see them"
    described = {
        "object": credit.to_dict(),
        "frame": views.described_frame(),
        "points": origin if len(model.points) else "none: the surface was not at hand",
        "light": "a point light an image, frame of the poses; radiant intensity in watts per steradian",
        "light_intensity": views.light_intensity,
        "images": {
            name: {"light_position": light.tolist(), "held_out": bool(is_held_out)}
            for name, light, is_held_out in zip(model.names, views.lights, views.held_out, strict=True)
        },
    }
    write_json(folder / "views.json", described)
    return len(model.points)


def sparse_model(views: PosedViews, surface: Surface | None, *, points: int, seed: int) -> SparseModel:
    """Return the model of views, and of points drawn on the surface (metres) with the views that see them.

    Positions are true, not triangulated: an observation is where the point projects, given only where a ray
    from the camera meets the point first and the object covers half of the pixel or more. A point's colour is
    the mean of what training views show there.
    """
    rotation, translation = world_to_camera(views.camera_to_object)
    positions, image, point, at = _observations(views, surface, points, seed)
    colours, inputs = _mean_colours(views, len(positions), image, point, at)
    mask = (np.bincount(point, minlength=len(positions)) >= 2) & inputs
    new_index = np.cumsum(mask) - 1
    of_mask = mask[point]
    height, width = views.size
    return SparseModel(
        width, height, views.focal_length_px, quaternion(rotation), translation,
        [f"{name}.png" for name in views.names], positions[mask], colours[mask],
        image[of_mask], new_index[point[of_mask]], at[of_mask],
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
    for index, pose in enumerate(views.camera_to_object):
        local = (positions - pose[:3, 3]) @ pose[:3, :3]
        ahead = np.flatnonzero(local[:, 2] < 0)
        at = project(positions[ahead], pose, (height, width), views.field_of_view_deg)
        inside = ((at >= 0) & (at < [width, height])).all(axis=1)
        ahead, at = ahead[inside], at[inside]
        eye = pose[:3, 3] if views.frame == "object" else frame.to_object(pose[:3, 3])
        ray = metric[ahead] - eye
        distance = surface.ray_hits(np.broadcast_to(eye, ray.shape), ray).distance
        visible = np.abs(distance - 1) * np.linalg.norm(ray, axis=1) < SAME_POINT * frame.scale
        # A pixel that the object covers in small part does not show the point.
        column, row = np.floor(at).astype(np.int64).T
        visible &= views.rgba[index, row, column, 3] >= 0.5
        images.append(np.full(np.count_nonzero(visible), index))
        rows.append(ahead[visible])
        places.append(at[visible])
    return positions, np.concatenate(images), np.concatenate(rows), np.concatenate(places)


def _mean_colours(
    views: PosedViews, count: int, image: np.ndarray, point: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean colours (p, 3) uint8 over training views, and whether a training view sees a point (p,)."""
    column, row = np.floor(at).astype(np.int64).T
    rgba = straight_srgb(views.rgba[image, row, column])
    usable = ~views.held_out[image]
    visible = np.bincount(point[usable], minlength=count)
    sums = [np.bincount(point[usable], rgba[usable, channel], count) for channel in range(3)]
    mean = np.stack(sums, axis=1) / np.maximum(visible, 1)[:, None]
    return np.round(mean).astype(np.uint8), visible > 0


def write_text(folder: Path, model: SparseModel) -> None:
    """Write ``cameras.txt``, ``images.txt`` and ``points3D.txt`` into a folder, making it."""
    folder.mkdir(parents=True)
    (folder / "cameras.txt").write_text(
        "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[] = fx, fy, cx, cy\n"
        f"{CAMERA_ID} PINHOLE {model.width} {model.height} {' '.join(map(repr, model.intrinsics()))}\n"
    )
    visibility, tracks = model.observations()
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as X, Y, POINT3D_ID"]
    for row, (name, own) in enumerate(zip(model.names, visibility, strict=True)):
        pose = [*model.quaternions[row].tolist(), *model.translations[row].tolist()]
        lines.append(f"{row + 1} {' '.join(map(repr, pose))} {CAMERA_ID} {name}")
        lines.append(" ".join(f"{x:.6f} {y:.6f} {point}" for (x, y), point in own.tolist()))
    (folder / "images.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    lines = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as IMAGE_ID, POINT2D_IDX"]
    for row, track in enumerate(tracks):
        cells = [*map(repr, model.points[row].tolist()), *map(str, model.colours[row].tolist()), "0.0"]
        lines.append(" ".join([str(row + 1), *cells, *map(str, track.ravel().tolist())]))
    (folder / "points3D.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_binary(folder: Path, model: SparseModel) -> None:
    """Write ``cameras.bin``, ``images.bin`` and ``points3D.bin`` into a folder, making it."""
    folder.mkdir(parents=True)
    camera = (1, CAMERA_ID, PINHOLE, model.width, model.height, *model.intrinsics())
    (folder / "cameras.bin").write_bytes(struct.pack("<QiiQQ4d", *camera))
    visibility, tracks = model.observations()
    with (folder / "images.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(model.names)))
        for row, (name, own) in enumerate(zip(model.names, visibility, strict=True)):
            pose = (*model.quaternions[row], *model.translations[row])
            file.write(struct.pack("<i7di", row + 1, *pose, CAMERA_ID) + name.encode() + b"\0")
            file.write(struct.pack("<Q", len(own)) + own.tobytes())
    with (folder / "points3D.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(tracks)))
        for row, track in enumerate(tracks):
            file.write(struct.pack("<Q3d3Bd", row + 1, *model.points[row], *model.colours[row].tolist(), 0.0))
            file.write(struct.pack("<Q", len(track)) + track.astype("<i4").tobytes())
