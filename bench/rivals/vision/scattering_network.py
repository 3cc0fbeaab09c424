"""The network of ObjectFolder 1.0's VisionNet: an object-centric neural scattering function.

(position, direction of the camera's ray, light) -> (density, colour scattered along the ray), as in
"Object-Centric Neural Scene Rendering" (Guo et al. 2020) and in the authors' public inference code: eight
layers of 256 with ReLU on the position and its sines and cosines at 1, 2, 4 .. 512 radians a unit; the
position joins again after the fifth layer; density is linear in the last layer; a linear layer of 256, joined
by the directions with their sines and cosines at 1, 2, 4, 8, leads through one layer of 128 to the colour.
"""

import torch
from torch import Tensor, nn

from bench.rivals.published import encode

DEPTH, WIDTH, JOINED = 8, 256, 5  # the position joins again at layer `JOINED`, counted from 0
POSITION_FREQUENCIES, DIRECTION_FREQUENCIES = 10, 4
# As published, colours may pass the ends of [0, 1] a little, so that white does not need infinite weights.
COLOUR_STRETCH = 1.2


def encoded_size(frequencies: int) -> int:
    """Return how many numbers `encode` makes of three."""
    return 3 * (1 + 2 * frequencies)


class ScatteringNetwork(nn.Module):
    """One of the two networks, coarse or fine.

    Weights start as torch's linear layers do, as the inference code leaves them.
    """

    def __init__(self) -> None:
        super().__init__()
        position, direction = encoded_size(POSITION_FREQUENCIES), encoded_size(DIRECTION_FREQUENCIES)
        entering = [position, *[WIDTH + (position if layer == JOINED else 0) for layer in range(1, DEPTH)]]
        self.hidden = nn.ModuleList([nn.Linear(size, WIDTH) for size in entering])
        self.density = nn.Linear(WIDTH, 1)
        self.bottleneck = nn.Linear(WIDTH, WIDTH)
        self.directed = nn.Linear(WIDTH + 2 * direction, WIDTH // 2)
        self.colour = nn.Linear(WIDTH // 2, 3)

    def forward(self, positions: Tensor, views: Tensor, lights: Tensor) -> tuple[Tensor, Tensor]:
        """Evaluate on points of rays.

        Parameters
        ----------
        positions
            (rays, samples, 3) unit frame.
        views
            (rays, 3) unit directions of the rays, away from the camera.
        lights
            (rays, 3) the light of each ray.

        Returns
        -------
        density, colour
            (rays, samples) before the ReLU that makes it an extinction, and (rays, samples, 3) sRGB-encoded.
        """
        encoded = encode(positions, POSITION_FREQUENCIES)
        value = encoded
        for index, layer in enumerate(self.hidden):
            if index == JOINED:
                value = torch.cat([encoded, value], dim=-1)
            value = torch.relu(layer(value))
        directions = torch.cat(
            [encode(views, DIRECTION_FREQUENCIES), encode(lights, DIRECTION_FREQUENCIES)], dim=-1
        )
        directions = directions[:, None].expand(*positions.shape[:2], -1)
        directed = torch.relu(self.directed(torch.cat([self.bottleneck(value), directions], dim=-1)))
        colour = COLOUR_STRETCH * (torch.sigmoid(self.colour(directed)) - 0.5) + 0.5
        return self.density(value)[..., 0], colour
