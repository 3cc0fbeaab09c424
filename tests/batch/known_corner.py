"""A corner of a floor and a wall of known material, with all maps that a file may have."""

import numpy as np

from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.network.surface_maps import MAP_WHOLE, SurfaceMaps, lattice_of
from objectfolder.vision.visionnet.sight_queries import SightQueries
from objectfolder.vision.visionnet.visionnet import VisionNet

STEPS = 6
PITCH = 1 / 24


def known_corner() -> SightQueries:
    """A rough matt floor that turns into smooth metal, bent by waves, and a wall with a hole."""
    at = np.linspace(0, 1, STEPS + 1)
    u, v = (part.ravel() for part in np.meshgrid(at, at))
    first = np.arange(len(u)).reshape(STEPS + 1, -1)
    a, b, c, d = (part.ravel() for part in (first[:-1, :-1], first[:-1, 1:], first[1:, 1:], first[1:, :-1]))
    floor = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    vertices = np.concatenate([np.stack([u, v, 0 * u], axis=1), np.stack([0 * u, v, u], axis=1)])
    surface = Surface(vertices, np.concatenate([floor, floor[:, ::-1] + len(u)]))
    frame = UnitFrame.of_points(vertices)
    triangles = frame.to_unit(vertices)[surface.faces]

    def levels(name: str) -> np.ndarray:
        lattice = lattice_of(name, triangles, PITCH)
        face, barycentric = lattice.places(np.zeros((1, 2)))
        x, y, z = surface.points_at(face, barycentric).T
        shares = {
            "albedo": (0.3 + 0.5 * x, 0.8 - 0.5 * y, 0.4 + 0.4 * z),
            "roughness": (0.6 - 0.3 * y,),
            "metallic": (np.clip(2 * x - 0.5, 0, 1),),
            "normal": (1 + 0.2 * np.sin(9 * x), 1 + 0.2 * np.cos(7 * y)),
            "alpha": (np.hypot(y - 0.5, z - 0.6) > 0.2,),
        }[name]
        values = np.stack(shares, axis=1).astype(float)
        return np.rint(MAP_WHOLE[name] * lattice.mean(values)).astype(np.uint8)

    names = "albedo", "roughness", "metallic", "normal", "alpha"
    maps = SurfaceMaps(
        surface, triangles, dict.fromkeys(names, PITCH), {name: levels(name) for name in names}
    )
    net = VisionNet(
        surface, frame, None, {}, radiance_scale=2.0, camera_radius=2.5, maps=maps,
        appearance=Appearance(0.5, 0.0),
    )  # fmt: skip
    return SightQueries(surface, frame, net)
