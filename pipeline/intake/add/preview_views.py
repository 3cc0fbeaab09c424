"""A textured mesh drawn to scale from several sides, and cut open: parallel rays, no renderer."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.mesh.mesh import TexturedMesh
from objectfolder.surface.texture_lookup import bilinear

Floats = NDArray[np.float64]

SAMPLES = 2
"""Rays a side of a pixel."""

WHITE = 1.0
CUT = np.array([0.85, 0.45, 0.15])
"""Colour of material that is cut through."""

LIGHT = (-0.45, 0.55, 0.9)
"""Direction to the lamp along the picture's right, up and back."""

Tint = Callable[[Floats, Floats, Floats], Floats]
"""From points (n, 3), outward normals (n, 3) and colours (n, 3) to colours (n, 3)."""


@dataclass(frozen=True)
class View:
    """Where a picture is taken from.

    Parameters
    ----------
    title
        What it shows, in words.
    right, up, back
        Unit vectors of the picture's sides, and from the object to the eye.
    cut
        Leave out the half nearer to the eye.
    """

    title: str
    right: Floats
    up: Floats
    back: Floats
    cut: bool = False


def standard_views(extents: Floats, up_axis: int) -> tuple[View, ...]:
    """Two corners, two sides, from above, and a section along the object's longer side."""
    up = np.eye(3)[up_axis]
    first, second = (axis for axis in range(3) if axis != up_axis)
    # The section holds the longer of the two horizontal axes.
    across = np.eye(3)[second if extents[first] >= extents[second] else first]
    along = np.cross(up, across)

    def view(title: str, back: Floats, above: Floats, cut: bool = False) -> View:
        back = back / np.linalg.norm(back)
        right = np.cross(above, back)
        right /= np.linalg.norm(right)
        return View(title, right, np.cross(back, right), back, cut)

    return (
        view("from a corner", 0.8 * along + across + 0.7 * up, up),
        view("from behind, below", -along - 0.8 * across - 0.6 * up, up),
        view("from a side", across, up),
        view("from an end", along, up),
        view("from above", up, across),
        view("cut open", across, up, cut=True),
    )


def side_m(mesh: TexturedMesh, views: tuple[View, ...]) -> float:
    """Side of a square that every view of the mesh fits in, metres."""
    corners = mesh.vertices - _centre(mesh)
    reach = [np.abs(corners @ axis).max() for view in views for axis in (view.right, view.up)]
    return 2.12 * float(max(reach))


def draw(mesh: TexturedMesh, view: View, side: float, pixels: int, tint: Tint | None = None) -> np.ndarray:
    """Draw a view to scale.

    Parameters
    ----------
    side
        Of the square that is shown, metres.
    pixels
        A side of the picture.
    tint
        Changes colours before they are lit.

    Returns
    -------
    np.ndarray
        (pixels, pixels, 3) uint8 on white, its first row on top.
    """
    right, up, back = view.right, view.up, view.back
    surface = mesh.surface
    reach = 2 * float(np.linalg.norm(mesh.extents))
    count = pixels * SAMPLES
    steps = ((np.arange(count) + 0.5) / count - 0.5) * side
    x, y = np.meshgrid(steps, -steps)
    start = _centre(mesh) + (0 if view.cut else reach) * back
    origins = start + x.reshape(-1, 1) * right + y.reshape(-1, 1) * up
    hits = surface.ray_hits(origins, np.broadcast_to(-back, origins.shape))
    seen = hits.face >= 0
    colours = np.full((len(origins), 3), WHITE)
    faces, normals = hits.face[seen], surface.face_normals[hits.face[seen]]
    facing = normals @ back
    own = _texture(mesh, faces, hits.barycentric[seen])
    if tint is not None:
        own = tint(surface.points_at(faces, hits.barycentric[seen]), normals, own)
    lamp = (LIGHT[0] * right + LIGHT[1] * up + LIGHT[2] * back) / np.linalg.norm(LIGHT)
    lit = 0.45 + 0.55 * np.abs(normals @ lamp)
    own = own * lit[:, None]
    if view.cut:
        own[facing < 0] = CUT
    colours[seen] = own
    image = colours.reshape(pixels, SAMPLES, pixels, SAMPLES, 3).mean(axis=(1, 3))
    return np.asarray(np.rint(255 * np.clip(image, 0, 1)), dtype=np.uint8)


def _texture(mesh: TexturedMesh, faces: NDArray[np.int64], barycentric: Floats) -> Floats:
    coordinates = np.einsum("ij,ijk->ik", barycentric, mesh.texture_coordinates[faces])
    colours = np.empty((len(faces), 3))
    for index, texture in enumerate(mesh.textures):
        chosen = mesh.face_texture[faces] == index
        colours[chosen] = bilinear(texture, coordinates[chosen])[:, :3]
    return colours


def _centre(mesh: TexturedMesh) -> Floats:
    return np.asarray((mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2)
