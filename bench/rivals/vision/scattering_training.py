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

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bench.rivals.vision.ray_sampling import refined, stratified
from bench.rivals.vision.scattering_function import (
    BEHIND_CENTRE,
    COARSE_SAMPLES,
    FINE_SAMPLES,
    NEAR,
    ScatteringFunction,
    Training,
    march,
    networks_of,
)
from bench.rivals.vision.scattering_network import ScatteringNetwork
from objectfolder.errors import InputError
from objectfolder.products.provenance import canonical_json
from objectfolder.products.store import Product
from objectfolder.products.tensor_file import TensorFile, read_tensor_file, write_tensor_file
from objectfolder.vision.cameras import focal_length_px
from objectfolder.vision.compositing import on_white

FULL_LENGTH = 200_000
BATCH_RAYS = 1024
FIRST_RATE, TENFOLD_FALL_STEPS = 5e-4, 250_000
DENSITY_NOISE = 1.0
# CPU seconds between two checkpoints.
CHECKPOINT_EVERY_S = 60.0

Rays = tuple[Tensor, Tensor, Tensor, Tensor]
Progress = Callable[[int, float, float], None]


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
        chosen = np.flatnonzero(~views["held_out"])
        if len(chosen) == 0:
            raise InputError("views", "every view is held out", "Render training views.")
        self.colours = np.stack([on_white(views["rgba"][view].astype(np.float32)) for view in chosen])
        self.cameras = views["camera_to_world"][chosen].astype(np.float64)
        self.lights = views["light_position"][chosen].astype(np.float64)
        self._focal = focal_length_px(self.colours.shape[1:3], float(views.attributes["field_of_view_deg"]))

    def draw(self, count: int, generator: np.random.Generator, device: torch.device) -> Rays:
        """Draw pixels evenly: origins, directions, lights and colours on white, each (count, 3) float32."""
        views, height, width = self.colours.shape[:3]
        view, row, column = (generator.integers(size, size=count) for size in (views, height, width))
        local = np.stack(
            [
                (column + 0.5 - width / 2) / self._focal,
                (height / 2 - row - 0.5) / self._focal,
                -np.ones(count),
            ],
            axis=1,
        )
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
    views: Product,
    *,
    steps: int | None = None,
    budget_cpu_s: float | None = None,
    batch_rays: int = BATCH_RAYS,
    seed: int = 0,
    device: str = "cpu",
    checkpoint: Path | None = None,
    progress: Progress | None = None,
) -> ScatteringFunction:
    """Fit ObjectFolder 1.0's VisionNet to the views that are not held out.

    One thread computes. Equal arguments with `steps` give equal weights on one machine, whether or not a fit
    was interrupted. With a budget the number of steps is what the time allowed; `training` tells.

    Parameters
    ----------
    views
        Product of `views.simulate_views`.
    steps
        Steps of the optimiser; the published length is `FULL_LENGTH`.
    budget_cpu_s
        CPU seconds of this process after which no step begins, those before an interruption included.
        One of `steps` and `budget_cpu_s` must be given; with both, whichever ends first.
    batch_rays
        Rays a step.
    seed
        Of weights and draws.
    device
        Torch device.
    checkpoint
        File in which the fit is kept now and then and at its end, and from which it goes on.
    progress
        Called after each step with its number, loss, and the CPU seconds so far.

    Raises
    ------
    InputError
        Neither `steps` nor `budget_cpu_s`, nothing to train on, or a checkpoint of another fit.
    """
    if (steps is None and budget_cpu_s is None) or (steps or 0) < 0 or (budget_cpu_s or 0) < 0:
        raise InputError(
            "scattering function", f"steps {steps}, budget {budget_cpu_s} CPU s",
            f"Give one that is not negative; the published length is {FULL_LENGTH} steps.",
        )  # fmt: skip
    pixels = TrainingPixels(views)
    far = float(views.attributes["camera_radius"]) + BEHIND_CENTRE
    fit = _Fit(seed, batch_rays, device, _described(views, seed, batch_rays))
    if checkpoint is not None and checkpoint.exists():
        fit.resume(checkpoint)
    with _one_thread():
        fit.run(pixels, far, steps, budget_cpu_s, checkpoint, progress)
    return ScatteringFunction(
        fit.coarse.eval(),
        fit.fine.eval(),
        float(views.attributes["camera_radius"]),
        Training(len(fit.losses), batch_rays, np.array(fit.losses), fit.cpu_s, device),
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """Sums over batches depend on the number of threads."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _described(views: Product, seed: int, batch_rays: int) -> dict[str, Any]:
    """Return what must be the same for a fit to go on from a checkpoint."""
    return {
        "seed": seed,
        "batch_rays": batch_rays,
        "shape": list(views["rgba"].shape),
        "lights": float(views["light_position"].sum()),
        "radiance": float(views["rgba"].astype(np.float64).sum()),
    }


class _Fit:
    """Networks, optimiser and what a checkpoint holds."""

    def __init__(self, seed: int, batch_rays: int, device: str, described: dict[str, Any]) -> None:
        self.seed, self.batch_rays, self.described = seed, batch_rays, described
        self.device = torch.device(device)
        self.coarse, self.fine = networks_of(seed, device)
        self.parameters = [*self.coarse.parameters(), *self.fine.parameters()]
        self.optimiser = torch.optim.Adam(self.parameters, lr=FIRST_RATE)
        self.losses: list[float] = []
        self.cpu_s = 0.0

    def run(
        self,
        pixels: TrainingPixels,
        far: float,
        steps: int | None,
        budget_cpu_s: float | None,
        checkpoint: Path | None,
        progress: Progress | None,
    ) -> None:
        """Take steps up to their number or the budget; save now and then, and at the end."""
        start, saved_s = time.process_time() - self.cpu_s, self.cpu_s
        while (steps is None or len(self.losses) < steps) and (
            budget_cpu_s is None or self.cpu_s < budget_cpu_s
        ):
            self.step(pixels, far)
            self.cpu_s = time.process_time() - start
            if progress is not None:
                progress(len(self.losses), self.losses[-1], self.cpu_s)
            if checkpoint is not None and self.cpu_s - saved_s > CHECKPOINT_EVERY_S:
                self.save(checkpoint)
                saved_s = self.cpu_s
        if checkpoint is not None:
            self.save(checkpoint)

    def step(self, pixels: TrainingPixels, far: float) -> None:
        """Take one step; its draws depend on the seed and its number alone."""
        generator = np.random.default_rng([self.seed, len(self.losses)])
        origins, directions, lights, colours = pixels.draw(self.batch_rays, generator, self.device)
        for group in self.optimiser.param_groups:
            group["lr"] = FIRST_RATE * 0.1 ** (len(self.losses) / TENFOLD_FALL_STEPS)

        def uniform(samples: int) -> Tensor:
            drawn = generator.random((self.batch_rays, samples), dtype=np.float32)
            return torch.as_tensor(drawn, device=self.device)

        def error(network: ScatteringNetwork, distances: Tensor) -> tuple[Tensor, Tensor]:
            drawn = generator.standard_normal(tuple(distances.shape), dtype=np.float32)
            noise = DENSITY_NOISE * torch.as_tensor(drawn, device=self.device)
            colour, shares = march(network, origins, directions, lights, distances, noise)
            on_background = colour + (1.0 - shares.sum(dim=1, keepdim=True))
            return (on_background - colours).square().mean(), shares

        distances = stratified(NEAR, far, uniform(COARSE_SAMPLES))
        coarse_error, shares = error(self.coarse, distances)
        fine_error, _ = error(self.fine, refined(distances, shares.detach(), uniform(FINE_SAMPLES)))
        loss = coarse_error + fine_error
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        self.optimiser.step()
        self.losses.append(float(loss.item()))

    def save(self, path: Path) -> None:
        """Write everything that the next step needs."""
        tensors = {f"weight.{i}": value.detach().cpu().numpy() for i, value in enumerate(self.parameters)}
        for index, state in self.optimiser.state_dict()["state"].items():
            tensors[f"first_moment.{index}"] = state["exp_avg"].cpu().numpy()
            tensors[f"second_moment.{index}"] = state["exp_avg_sq"].cpu().numpy()
        tensors["losses"] = np.array(self.losses, dtype=np.float64)
        write_tensor_file(path, TensorFile(tensors, {"fit": self.described, "cpu_s": self.cpu_s}))

    def resume(self, path: Path) -> None:
        """Go on from what `save` wrote."""
        content = read_tensor_file(path)
        if content.metadata.get("fit") != canonical_json(self.described):
            raise InputError(
                str(path), "a checkpoint of other views, seed or batch", "Delete it or name another file."
            )
        tensors = {name: torch.tensor(np.array(value)) for name, value in content.tensors.items()}
        self.losses = content.tensors["losses"].tolist()
        self.cpu_s = float(content.metadata["cpu_s"])
        with torch.no_grad():
            for index, parameter in enumerate(self.parameters):
                parameter.copy_(tensors[f"weight.{index}"])
        if self.losses:
            state = self.optimiser.state_dict()
            state["state"] = {
                index: {
                    "step": torch.tensor(float(len(self.losses))),
                    "exp_avg": tensors[f"first_moment.{index}"],
                    "exp_avg_sq": tensors[f"second_moment.{index}"],
                }
                for index in range(len(self.parameters))
            }
            self.optimiser.load_state_dict(state)
