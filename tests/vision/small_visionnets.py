"""VisionNets of drawn weights on small shapes: nothing is fitted, everything is asked."""

import numpy as np
import torch

from objectfolder.making.visionnet.reflectance import Reflectance
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.network.material import Material
from objectfolder.vision.network.sparse_grid import SparseGrid, covering_points
from objectfolder.vision.visionnet.visionnet import VisionNet

WAYS = ("learned", "known")
MATT = Appearance(0.5, 0.0, 0.0)


class Even(Material):
    """One albedo all over."""

    albedo = 0.5

    def states(self, name: str) -> bool:
        return True

    def value(self, name: str, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        if name == "albedo":
            return np.full((len(face), 3), self.albedo)
        return super().value(name, face, barycentric)


def visionnet(surface: Surface | TexturedMesh, way: str) -> VisionNet:
    """A VisionNet whose light is of a network of drawn weights, or of an even matt material."""
    if way == "learned":
        return drawn_visionnet(surface)
    surface = surface.surface if isinstance(surface, TexturedMesh) else surface
    frame = UnitFrame.of_points(surface.vertices)
    net = VisionNet(surface, frame, None, {}, radiance_scale=0.5, camera_radius=2.5, appearance=MATT)
    net._material = Even(None, MATT)
    return net


def drawn_visionnet(surface: Surface | TexturedMesh, seed: int = 0, resolution: int = 32) -> VisionNet:
    """A network whose colours differ from place to place, angle to angle and light to light."""
    surface = surface.surface if isinstance(surface, TexturedMesh) else surface
    frame = UnitFrame.of_points(surface.vertices)
    grid = SparseGrid.of_points(
        covering_points(surface, frame.to_unit(surface.vertices), resolution), resolution
    )
    network = Reflectance(grid.sizes)
    network.initialise(torch.Generator().manual_seed(seed))
    with torch.no_grad():
        for table in network.tables:
            table.mul_(500)
        network.get_parameter("bounced.4.weight").mul_(3)
    weights = {name: value.numpy().astype(np.float16) for name, value in network.state_dict().items()}
    return VisionNet(surface, frame, grid, weights, radiance_scale=0.5, camera_radius=2.5)
