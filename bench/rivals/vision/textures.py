"""What an object looks like to those who know its mesh and texture but trace no light.

Both use the source mesh and its texture, far more than an Object File holds, the true light, and the same
integration over pixels as VisionNet; what they lack is reflections, and light that has bounced. Holes of a
texture are taken as closed.
"""

from functools import partial
from typing import Literal

import numpy as np

from objectfolder.errors import InputError, QueryError
from objectfolder.products.store import Product
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.cameras import image_size
from objectfolder.vision.compositing import srgb_decode
from objectfolder.vision.network.incidence import UnitSurface
from tests.references.pixel_integration import integrate_pixels

Shading = Literal["unlit", "lambert", "shadowed lambert"]
SHADINGS: tuple[Shading, ...] = ("unlit", "lambert", "shadowed lambert")
SUB_RAYS = 64


def texture_colours(mesh: TexturedMesh, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Return linear base colours (n, 3) at barycentric coordinates (n, 3) of faces (n,).

    Interpolated as stored and decoded then, as Cycles does.
    """
    coordinates = np.einsum("ij,ijk->ik", barycentric, mesh.texture_coordinates[face])
    colours = np.empty((len(face), 3))
    for index, texture in enumerate(mesh.textures):
        mask = mesh.face_texture[face] == index
        colours[mask] = bilinear(texture[..., :3], coordinates[mask])
    return srgb_decode(colours)


class TexturedSurface:
    """The source mesh with its texture, rendered without path tracing.

    Parameters
    ----------
    mesh
        The object, metres.
    frame
        Its unit frame.
    shading
        ``"unlit"``: the texture itself. ``"lambert"``: times the cosine and inverse square of the light,
        ``"shadowed lambert"``: and its visibility, that is, all the direct light of a matt surface.
    light_power_w
        Radiant power of the point light.

    Raises
    ------
    InputError
        An unknown shading.
    """

    def __init__(self, mesh: TexturedMesh, frame: UnitFrame, shading: Shading, light_power_w: float) -> None:
        if shading not in SHADINGS:
            raise InputError("shading", f"{shading!r} is not known", f"Choose one of {', '.join(SHADINGS)}.")
        self.shading = shading
        self._mesh = mesh
        self._surface = UnitSurface(mesh.surface, frame)
        self._scale = light_power_w / (4 * np.pi**2)

    def render(
        self,
        camera_to_world: np.ndarray,
        light_position: np.ndarray,
        resolution: int | tuple[int, int],
        field_of_view_deg: float,
        sub_rays: int = SUB_RAYS,
    ) -> np.ndarray:
        """Render views; arguments and result as of `visionnet.VisionNet.render`.

        Raises
        ------
        QueryError
            Shapes that do not match.
        """
        cameras = np.asarray(camera_to_world, dtype=np.float64).reshape(-1, 4, 4)
        lights = np.asarray(light_position, dtype=np.float64).reshape(-1, 3)
        if len(cameras) != len(lights):
            raise QueryError(
                "render", f"{len(cameras)} cameras but {len(lights)} lights", "Give one light a camera."
            )
        size = image_size(resolution)
        corners = self._surface.triangles.reshape(-1, 3)
        images = [
            integrate_pixels(
                partial(self.radiance, light=light), camera, size, field_of_view_deg, sub_rays, corners
            )
            for camera, light in zip(cameras, lights, strict=True)
        ]
        return np.stack(images) if images else np.zeros((0, *size, 4), dtype=np.float32)

    def radiance(self, origins: np.ndarray, directions: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return (n, 4) float32 scene-linear premultiplied RGBA along (n, 3) rays, unit frame."""
        rgba = np.zeros((len(directions), 4), dtype=np.float32)
        face, barycentric = self._surface.first_hits(origins, directions)
        hit = face >= 0
        if not hit.any():
            return rgba
        colour = texture_colours(self._mesh, face[hit], barycentric[hit])
        if self.shading != "unlit":
            points = self._surface.incidence(face[hit], barycentric[hit], directions[hit], light)
            arriving = points.irradiance
            if self.shading == "lambert":
                cosine = np.einsum("ij,ij->i", points.normal, points.to_light)
                arriving = np.maximum(cosine, 0.0) / np.maximum(points.distance, 1e-3) ** 2
            colour = colour * (self._scale * arriving)[:, None]
        rgba[hit, :3] = colour
        rgba[hit, 3] = 1.0
        return rgba


def mean_colour(views: Product) -> np.ndarray:
    """Return the mean linear colour (3,) of the object in the views that are not held out."""
    training = views["rgba"][~views["held_out"]].astype(np.float64)
    total: np.ndarray = training[..., :3].sum(axis=(0, 1, 2)) / max(training[..., 3].sum(), 1e-12)
    return total
