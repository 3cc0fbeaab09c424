"""A COLMAP sparse model: cameras, images and points, as text and as binary.

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

CAMERA_ID = 1
# COLMAP's number of the PINHOLE model.
PINHOLE = 1
OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0])


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


def world_to_camera(camera_to_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (n, 3, 3) and translations (n, 3), world to camera, of (n, 4, 4) OpenGL poses."""
    rotation = OPENGL_TO_OPENCV @ camera_to_world[:, :3, :3].transpose(0, 2, 1)
    return rotation, -np.einsum("nij,nj->ni", rotation, camera_to_world[:, :3, 3])


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return (n, 4) unit Hamilton quaternions w, x, y, z, w >= 0, of (n, 3, 3) rotations.

    The eigenvector of Bar-Itzhack's symmetric matrix (2000): no case is singular, and rounding in the matrix
    is averaged out.
    """
    r = rotation
    k = np.empty((len(r), 4, 4))
    k[:, 0, 0] = r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    for axis in range(3):
        second, third = (axis + 1) % 3, (axis + 2) % 3
        k[:, 0, axis + 1] = k[:, axis + 1, 0] = r[:, third, second] - r[:, second, third]
        k[:, axis + 1, axis + 1] = r[:, axis, axis] - r[:, second, second] - r[:, third, third]
        k[:, axis + 1, second + 1] = k[:, second + 1, axis + 1] = r[:, axis, second] + r[:, second, axis]
    result = np.linalg.eigh(k)[1][:, :, -1]
    return np.where(result[:, :1] < 0, -result, result)


def write_text(folder: Path, model: SparseModel) -> None:
    """Write ``cameras.txt``, ``images.txt`` and ``points3D.txt`` into a folder, making it."""
    folder.mkdir(parents=True)
    numbers = (model.focal_length_px, model.focal_length_px, model.width / 2, model.height / 2)
    (folder / "cameras.txt").write_text(
        "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[] = fx, fy, cx, cy\n"
        f"{CAMERA_ID} PINHOLE {model.width} {model.height} {' '.join(map(repr, map(float, numbers)))}\n"
    )
    order, index_in_image, starts = _by_image(model)
    point_ids = (model.observed_point[order] + 1).tolist()
    observed = [
        f"{x:.6f} {y:.6f} {point}"
        for (x, y), point in zip(model.observed_at[order].tolist(), point_ids, strict=True)
    ]
    with (folder / "images.txt").open("w", encoding="utf-8") as file:
        file.write(
            "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as X, Y, POINT3D_ID\n"
        )
        for row, name in enumerate(model.names):
            pose = [*model.quaternions[row].tolist(), *model.translations[row].tolist()]
            file.write(f"{row + 1} {' '.join(map(repr, pose))} {CAMERA_ID} {name}\n")
            file.write(" ".join(observed[starts[row] : starts[row + 1]]) + "\n")
    tracks = _tracks(model, index_in_image)
    with (folder / "points3D.txt").open("w", encoding="utf-8") as file:
        file.write("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as IMAGE_ID, POINT2D_IDX\n")
        for row, (point, colour) in enumerate(
            zip(model.points.tolist(), model.colours.tolist(), strict=True)
        ):
            cells = [*map(repr, point), *map(str, colour), "0.0", *map(str, tracks[row].ravel().tolist())]
            file.write(f"{row + 1} {' '.join(cells)}\n")


def write_binary(folder: Path, model: SparseModel) -> None:
    """Write ``cameras.bin``, ``images.bin`` and ``points3D.bin`` into a folder, making it."""
    folder.mkdir(parents=True)
    parameters = (model.focal_length_px, model.focal_length_px, model.width / 2, model.height / 2)
    (folder / "cameras.bin").write_bytes(
        struct.pack("<QiiQQ4d", 1, CAMERA_ID, PINHOLE, model.width, model.height, *parameters)
    )
    order, index_in_image, starts = _by_image(model)
    observed = np.empty(len(order), dtype=[("at", "<f8", 2), ("point", "<u8")])
    observed["at"], observed["point"] = model.observed_at[order], model.observed_point[order] + 1
    with (folder / "images.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(model.names)))
        for row, name in enumerate(model.names):
            file.write(
                struct.pack("<i7di", row + 1, *model.quaternions[row], *model.translations[row], CAMERA_ID)
            )
            file.write(name.encode() + b"\0")
            own = observed[starts[row] : starts[row + 1]]
            file.write(struct.pack("<Q", len(own)) + own.tobytes())
    tracks = _tracks(model, index_in_image)
    with (folder / "points3D.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(model.points)))
        for row, (point, colour) in enumerate(
            zip(model.points.tolist(), model.colours.tolist(), strict=True)
        ):
            file.write(struct.pack("<Q3d3Bd", row + 1, *point, *colour, 0.0))
            file.write(struct.pack("<Q", len(tracks[row])) + tracks[row].astype("<i4").tobytes())


def _by_image(model: SparseModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the order of observations by image, each one's index there, and where images start."""
    order = np.argsort(model.observed_image, kind="stable")
    starts = np.searchsorted(model.observed_image[order], np.arange(len(model.names) + 1))
    index = np.empty(len(order), dtype=np.int64)
    index[order] = np.arange(len(order)) - starts[model.observed_image[order]]
    return order, index, starts


def _tracks(model: SparseModel, index_in_image: np.ndarray) -> list[np.ndarray]:
    """Return for each point its observations (k, 2): image id and index in that image."""
    order = np.argsort(model.observed_point, kind="stable")
    pairs = np.stack([model.observed_image[order] + 1, index_in_image[order]], axis=1)
    starts = np.searchsorted(model.observed_point[order], np.arange(len(model.points) + 1))
    return [pairs[first:last] for first, last in pairwise(starts)]
