"""A textured mesh drawn to scale from several sides, and cut open: parallel rays, no renderer."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.parallel_views import LIGHT_DIRECTION, Floats, axes_towards, look
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.surface.textured_mesh import TexturedMesh

SAMPLES = 2
"""Rays a side of a pixel."""

CUT = np.array([0.85, 0.45, 0.15])
"""Colour of material that is cut through."""

Tint = Callable[[Floats, Floats, Floats], Floats]
"""From points (n, 3), outward normals (n, 3) and colours (n, 3) to colours (n, 3)."""


class View(NamedTuple):
    """Where a picture is taken from.

    Parameters
    ----------
    title
        What it shows, in words.
    axes
        (3, 3) unit vectors: to the picture's right, up, and from the object to the eye.
    cut
        Leave out the half nearer to the eye.
    """

    title: str
    axes: Floats
    cut: bool = False


def standard_views(extents: Floats) -> list[View]:
    """Two corners, two sides, from above, and a section along the object's longer side."""
    along_x, along_y, up = np.eye(3)
    # The section holds the longer of the two horizontal axes.
    across = along_y if extents[0] >= extents[1] else along_x
    along = np.cross(up, across)
    return [
        View("from a corner", axes_towards(0.8 * along + across + 0.7 * up, up)),
        View("from behind, below", axes_towards(-along - 0.8 * across - 0.6 * up, up)),
        View("from a side", axes_towards(across, up)),
        View("from an end", axes_towards(along, up)),
        View("from above", axes_towards(up, across)),
        View("cut open", axes_towards(across, up), cut=True),
    ]


def side_m(mesh: TexturedMesh, views: list[View]) -> float:
    """Side of a square that every view of the mesh fits in, metres."""
    corners = mesh.vertices - mesh.surface.bounds.mean(axis=0)
    return 2.12 * max(float(np.abs(corners @ view.axes[:2].T).max()) for view in views)


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
    surface, back = mesh.surface, view.axes[2]
    hits = look(surface, view.axes, side, pixels * SAMPLES, 0.0 if view.cut else side)
    visible = hits.face >= 0
    faces, barycentric = hits.face[visible], hits.barycentric[visible]
    normals = surface.face_normals[faces]
    own = _texture(mesh, faces, barycentric)
    if tint is not None:
        own = tint(surface.points_at(faces, barycentric), normals, own)
    own = own * (0.45 + 0.55 * np.abs(normals @ view.axes.T @ LIGHT_DIRECTION))[:, None]
    if view.cut:
        own[normals @ back < 0] = CUT
    colours = np.ones((len(visible), 3))
    colours[visible] = own
    image = colours.reshape(pixels, SAMPLES, pixels, SAMPLES, 3).mean(axis=(1, 3))
    return np.asarray(np.rint(255 * np.clip(image, 0, 1)), dtype=np.uint8)


def _texture(mesh: TexturedMesh, faces: NDArray[np.int64], barycentric: Floats) -> Floats:
    coordinates = np.einsum("ij,ijk->ik", barycentric, mesh.texture_coordinates[faces])
    colours = np.empty((len(faces), 3))
    for index, texture in enumerate(mesh.textures):
        chosen = mesh.face_texture[faces] == index
        colours[chosen] = bilinear(texture, coordinates[chosen])[:, :3]
    return colours
