"""Fit ObjectFolder 1.0's VisionNet to the views that VisionNet is fitted to.

Published: Adam at 5e-4 (the authors' public inference code still makes the optimiser), the sum of the squared
errors of coarse and fine colours, samples jittered within their strata while training. Not published for
1.0, and decided here after NeRF (Mildenhall et al. 2020), whose training it follows: the rate falls by ten
in 250 000 steps; 1024 rays a step, drawn evenly from all pixels of all training views; normal noise of
deviation 1 on densities before their ReLU, without which a network of density zero has no gradient;
`FULL_LENGTH` steps. A step of 1024 rays evaluates a network 262 144 times each way: some 10 CPU seconds,
weeks for all steps, which is why a fit can stop at a budget of CPU seconds, with fewer rays a step, and is
then named by it.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from bench.rivals.published import fit
from bench.rivals.vision.ray_marching import refined, stratified
from bench.rivals.vision.scattering_function import (
    BEHIND_CENTRE,
    COARSE_SAMPLES,
    FINE_SAMPLES,
    NEAR,
    ScatteringFunction,
    march,
)
from bench.rivals.vision.scattering_network import ScatteringNetwork
from objectfolder.errors import InputError
from objectfolder.products.store import Product
from objectfolder.vision.cameras import focal_length_px
from objectfolder.vision.compositing import on_white

FULL_LENGTH = 200_000
BATCH_RAYS = 1024
FIRST_RATE, TENFOLD_FALL_STEPS = 5e-4, 250_000
DENSITY_NOISE = 1.0

Rays = tuple[Tensor, Tensor, Tensor, Tensor]


class TrainingPixels:
    """All pixels of the views that are not held out, as 8-bit colours on white.

    Parameters
    ----------
    views
        Product of `views.simulate_views`.

    Raises
    ------
    InputError
        No view to train on.
    """

    def __init__(self, views: Product) -> None:
        training = np.flatnonzero(~views["held_out"])
        if len(training) == 0:
            raise InputError("views", "every view is held out", "Render training views.")
        self.colours = np.stack([on_white(views["rgba"][view].astype(np.float32)) for view in training])
        self.cameras = views["camera_to_world"][training].astype(np.float64)
        self.lights = views["light_position"][training].astype(np.float64)
        self._focal = focal_length_px(self.colours.shape[1:3], float(views.attributes["field_of_view_deg"]))

    def draw(self, count: int, generator: np.random.Generator, device: torch.device) -> Rays:
        """Draw pixels evenly: origins, directions, lights and colours on white, each (count, 3) float32."""
        views, height, width = self.colours.shape[:3]
        view, row, column = (generator.integers(size, size=count) for size in (views, height, width))
        right = (column + 0.5 - width / 2) / self._focal
        up = (height / 2 - row - 0.5) / self._focal
        local = np.stack([right, up, -np.ones(count)], axis=1)
        directions = np.einsum("nij,nj->ni", self.cameras[view, :3, :3], local)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        parts = (
            self.cameras[view, :3, 3],
            directions,
            self.lights[view],
            self.colours[view, row, column] / 255.0,
        )
        origins, towards, lights, colours = (
            torch.as_tensor(part, dtype=torch.float32, device=device) for part in parts
        )
        return origins, towards, lights, colours


def fit_scattering_function(
    views: Product, *, batch_rays: int = BATCH_RAYS, device: str = "cpu", **options: Any
) -> ScatteringFunction:
    """Fit ObjectFolder 1.0's VisionNet to the views that are not held out.

    Parameters
    ----------
    views
        Product of `views.simulate_views`.
    batch_rays
        Rays a step.
    device
        Torch device.
    options
        Of `fit`: `steps` (the published length is `FULL_LENGTH`) or `budget_cpu_s`, and `seed`.

    Raises
    ------
    InputError
        Neither `steps` nor `budget_cpu_s`, or nothing to train on.
    """
    pixels, place = TrainingPixels(views), torch.device(device)
    radius = float(views.attributes["camera_radius"])
    far = radius + BEHIND_CENTRE

    def loss(networks: nn.ModuleList, generator: np.random.Generator) -> Tensor:
        coarse, fine = networks
        origins, directions, lights, colours = pixels.draw(batch_rays, generator, place)

        def uniform(samples: int) -> Tensor:
            values = generator.random((batch_rays, samples), dtype=np.float32)
            return torch.as_tensor(values, device=place)

        def error(network: Any, distances: Tensor) -> tuple[Tensor, Tensor]:
            values = generator.standard_normal(tuple(distances.shape), dtype=np.float32)
            noise = DENSITY_NOISE * torch.as_tensor(values, device=place)
            colour, shares = march(network, origins, directions, lights, distances, noise)
            on_background = colour + (1.0 - shares.sum(dim=1, keepdim=True))
            return (on_background - colours).square().mean(), shares

        distances = stratified(NEAR, far, uniform(COARSE_SAMPLES))
        coarse_error, shares = error(coarse, distances)
        return coarse_error + error(fine, refined(distances, shares.detach(), uniform(FINE_SAMPLES)))[0]

    networks, training = fit(
        lambda: nn.ModuleList([ScatteringNetwork(), ScatteringNetwork()]).to(place),
        loss,
        lambda step: FIRST_RATE * 0.1 ** (step / TENFOLD_FALL_STEPS),
        **options,
    )
    coarse, fine = networks
    return ScatteringFunction(coarse, fine, radius, training)
