"""Bodies of a scene that have no Object File: matt, of one colour."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.live.scene_light import BodyLight
from objectfolder.live.scene_view import CENTRE, Crop, View
from objectfolder.surface.surface import Surface
from objectfolder.vision.environment import Environment
from objectfolder.vision.lamps import LIGHT_POWER_W

Floats = NDArray[np.float64]
PIXEL_OFFSETS = np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]])  # of a pixel


@dataclass(frozen=True, eq=False)
class MattBody:
    """A convex body that reflects light as Lambert's law has it.

    Parameters
    ----------
    surface
        Metres, in the frame of its body; convex, for it throws no shadow on itself.
    albedo
        (3,) linear red, green and blue, 0 to 1.
    """

    surface: Surface
    albedo: tuple[float, float, float] = (0.1, 0.1, 0.11)

    def seen(self, view: View, crop: Crop, light: BodyLight, smooth: bool) -> tuple[Floats, Floats]:
        """Return premultiplied colour (h, w, 4) and depth (h, w) in a part of a view, all in its own frame.

        Parameters
        ----------
        light
            Lamps, and an environment of which the body hides what is behind each side, and no more.
        smooth
            Whether edges are: four rays a pixel beside that through its centre.
        """
        starts, along = view.rays_in(crop, np.concatenate([CENTRE, PIXEL_OFFSETS]) if smooth else CENTRE)
        hits = self.surface.ray_hits(starts, along)
        hit, rgba = np.isfinite(hits.distance), np.zeros((len(along), 4))
        points = starts[hit] + hits.distance[hit, None] * along[hit]
        normals = self.surface.normals_at(hits.face[hit], hits.barycentric[hit])
        away = light.lamps_m[:, None] - points
        squared = np.maximum((away**2).sum(axis=-1), 1e-12)
        falls = np.maximum((away * normals).sum(axis=-1), 0.0) / squared**1.5
        arriving = LIGHT_POWER_W / (4 * np.pi) * (falls.T @ light.colours)
        if light.around is not None:
            arriving += _irradiance(light.around, normals @ light.turn.T)
        rgba[hit, :3] = arriving * self.albedo / np.pi
        rgba[hit, 3] = 1.0
        depth = (hits.distance * -(along @ view.camera[:3, 2])).reshape(*crop[2:], -1)[..., 0]
        several = rgba.reshape(*crop[2:], -1, 4)
        return several[..., 1:, :].mean(axis=2) if smooth else several[..., 0, :], depth


def _irradiance(around: Environment, normals: Floats) -> Floats:
    """Return what arrives (n, 3) at planes of normals (n, 3), nothing in the way."""
    from objectfolder.vision.compiled.surroundings import looked_up  # compiles kernels

    table = around.irradiance
    arriving: Floats = looked_up(
        table.reshape(-1, 3), np.array([len(table)]), normals, np.zeros(len(normals))
    )
    return arriving
