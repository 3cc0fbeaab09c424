"""VisionNets of drawn weights on small shapes: nothing is fitted, everything is asked."""

import numpy as np
import torch

from objectfolder.mesh.mesh import TexturedMesh
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.network.reflectance import Reflectance
from objectfolder.vision.network.sparse_grid import SparseGrid, covering_points
from objectfolder.vision.rendering.torch_renderer import TorchRenderer
from objectfolder.vision.visionnet.visionnet import VisionNet

WAYS = ("compiled", "torch")
# Radiance in single precision, of values near 1.
ROUNDING = 2e-6


def rendered_by(net: VisionNet, way: str) -> VisionNet:
    """Return the same VisionNet, rendered on the CPU by kernels or by torch."""
    other = net.on("cpu")
    if way == "torch":
        other._renderer = TorchRenderer(net._surface, net._grid, net._weights, net.radiance_scale)
    return other


def way_of(net: VisionNet) -> str:
    return "torch" if isinstance(net._renderer, TorchRenderer) else "compiled"


def assert_alike(answer: np.ndarray, expected: np.ndarray, way: str) -> None:
    """Answers (..., 4) to the same rays in different company: equal, or for torch's way apart by rounding.

    Torch multiplies matrices by libraries that may round a row by its place among others. One pixel may
    differ by more: one whose few rays differ by just as much as makes it uneven.
    """
    if way == "compiled":
        np.testing.assert_array_equal(answer, expected)
        return
    assert answer.shape == expected.shape
    apart = np.abs(answer - expected) > ROUNDING * (1 + np.abs(expected))
    assert apart.any(axis=-1).sum() <= 1


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
