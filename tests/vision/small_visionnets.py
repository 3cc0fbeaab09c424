"""VisionNets of drawn weights on small shapes: nothing is fitted, everything is asked."""

import numpy as np
import torch

from objectfolder.geometry.frames import UnitFrame
from objectfolder.geometry.mesh import TexturedMesh
from objectfolder.geometry.surface import Surface
from objectfolder.vision.reflectance import Reflectance
from objectfolder.vision.sparse_grid import SparseGrid, covering_points
from objectfolder.vision.visionnet import VisionNet


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
