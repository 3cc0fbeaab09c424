"""Fit a VisionNet's weights to the training views of an object.

Adam is taken by torch's function: its class imports torch's compiler, 2.5 CPU-s in each process that fits.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch.optim.adam import adam

from objectfolder.errors import InputError
from objectfolder.extras import needs_extra
from objectfolder.making.device import torch_device
from objectfolder.making.visionnet.reflectance import (
    Mirrored,
    Reflectance,
    angle_inputs,
    fifth_power_of_rim,
    surrounding_inputs,
)
from objectfolder.products.store import Product
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import pixel_rays, sub_ray_offsets
from objectfolder.vision.compositing import SRGB_KNEE
from objectfolder.vision.network.incidence import Incidence, UnitSurface
from objectfolder.vision.network.sparse_grid import SparseGrid

EPSILON = 1e-12


class Adam:
    """Moves parameters against their gradients, each by about the rate.

    Parameters
    ----------
    parameters
        Tensors that gradients flow to.
    """

    def __init__(self, parameters: Iterable[torch.Tensor]) -> None:
        self._parameters = list(parameters)
        self._means = [torch.zeros_like(each) for each in self._parameters]
        self._squares = [torch.zeros_like(each) for each in self._parameters]
        self._counts = [torch.zeros(()) for _ in self._parameters]

    def step(self, rate: float) -> None:
        """Move those that have a gradient, and forget it."""
        moved = [index for index, each in enumerate(self._parameters) if each.grad is not None]
        lists = (self._parameters, self._means, self._squares, self._counts)
        parameters, means, squares, counts = ([values[index] for index in moved] for values in lists)
        gradients = [each.grad for each in parameters if each.grad is not None]
        with torch.no_grad():
            adam(
                parameters, gradients, means, squares, [], counts, foreach=True, amsgrad=False,
                beta1=0.9, beta2=0.999, lr=rate, weight_decay=0.0, eps=EPSILON, maximize=False,
            )  # fmt: skip
        for each in parameters:
            each.grad = None


with needs_extra("factory"):
    import torch

# A mirror shows the lamp, a point, to no pixel: its highlight starts a little wider, and is never narrower.
LEAST_ALPHA = 0.0025
# Albedo below which training starts from the object's own.
DARK = 0.05
# Sub-rays of a step on which the unevenness of the reflectance is measured.
EVEN_RAYS = 1024


@dataclass(frozen=True)
class MirrorRays:
    """Points lit by the lamp that sub-rays see in the surface as in a mirror.

    Parameters
    ----------
    place
        (n,) int32 for each sub-ray the row of its point below, or -1.
    rim
        (m, 1) of the mirror, see `reflectance.fifth_power_of_rim`.
    position, angles, irradiance
        (m, ...) as of `TrainingRays`.
    """

    place: np.ndarray
    rim: np.ndarray
    position: np.ndarray
    angles: np.ndarray
    irradiance: np.ndarray


@dataclass(frozen=True)
class TrainingRays:
    """Sub-rays that hit the surface, sorted by pixel.

    Parameters
    ----------
    position, angles, surroundings, irradiance
        A row for each sub-ray: the inputs of `Reflectance`.
    first, count
        (pixels,) where a pixel's sub-rays begin, and how many there are.
    colour
        (pixels, 3) float32 straight linear colour.
    weight
        (pixels,) float32 squared coverage.
    alpha
        GGX width of the surface shown, where the highlight starts from.
    metallic
        Of the surface shown.
    mirrored
        What the surface shows of itself; None if that is not asked.
    base_colour
        (pixels, 3) float32 base colour at the pixel's centre; None where the views have no such pass.
    base_weight
        (pixels,) float32 squared coverage, 0 where the centre does not show the object.
    """

    position: np.ndarray
    angles: np.ndarray
    surroundings: np.ndarray
    irradiance: np.ndarray
    first: np.ndarray
    count: np.ndarray
    colour: np.ndarray
    weight: np.ndarray
    alpha: float
    metallic: float
    mirrored: MirrorRays | None = None
    base_colour: np.ndarray | None = None
    base_weight: np.ndarray | None = None


@dataclass(frozen=True)
class Priors:
    """What is known of a surface besides its radiance, as weights of terms of the loss.

    Most of a mug's inside is seen in the dark only: of what such pixels show, many products of albedo and
    bounced light are the cause, and each answers differently once a lamp shines in.

    Parameters
    ----------
    base_colour
        Of the error of the albedo against the base-colour pass, both encoded as an image is. An albedo
        scales what is learned of angles and of bounced light, so equality with the source costs no freedom.
    evenness
        Of `Reflectance.unevenness`: the reflectance over the albedo is alike all over unless light shows
        otherwise.
    """

    base_colour: float = 0.0
    evenness: float = 0.0


def trace_training_rays(
    surface: UnitSurface, views: Product, sub_rays: int, most_pixels: int, seed: int,
    mirrors: bool = False,
) -> TrainingRays:  # fmt: skip
    """Trace `sub_rays` jittered rays through covered pixels of the views that are not held out.

    All of them, or a random choice of about `most_pixels`: it bounds memory at 194 bytes a ray and 16 a
    pixel; where `mirrors` are asked for, 4 more and 72 for each ray that sees a lit part of the surface in
    itself.

    Raises
    ------
    InputError
        No training view shows the object.
    """
    random = np.random.default_rng(seed)
    chosen = np.flatnonzero(~views["held_out"])
    share = most_pixels / max(1, sum(int(np.count_nonzero(views["rgba"][view][..., 3])) for view in chosen))
    height, width = views["rgba"].shape[1:3]
    known = {"albedo", "mask"} <= set(views.arrays)
    offsets = sub_ray_offsets(sub_rays)
    parts: list[tuple[np.ndarray, ...]] = []
    pixels_of: list[tuple[np.ndarray, ...]] = []
    bases: list[tuple[np.ndarray, ...]] = []
    seen_again: list[tuple[np.ndarray, ...]] = []
    met = 0
    for view in chosen:
        rgba = views["rgba"][view].astype(np.float32).reshape(-1, 4)
        pixels = np.flatnonzero(rgba[:, 3] > 0)
        if share < 1:
            pixels = pixels[random.random(len(pixels)) < share]
        # The lattice, shifted at random around each pixel.
        shifted = (offsets + random.random((len(pixels), 1, 2))) % 1.0
        origins, directions = pixel_rays(
            views["camera_to_world"][view], pixels, shifted, (height, width),
            views.attributes["field_of_view_deg"],
        )  # fmt: skip
        face, barycentric = surface.first_hits(origins, directions)
        hit = face >= 0
        light = views["light_position"][view]
        points = surface.incidence(face[hit], barycentric[hit], directions[hit], light)
        count = hit.reshape(-1, sub_rays).sum(axis=1)
        seen = count > 0
        alpha = np.clip(rgba[pixels, 3:], 0.0, 1.0)[seen]
        parts.append(_inputs(points, light))
        if mirrors:
            seen_again.append(_mirrored(surface, face[hit], points, light, met))
            met += len(seen_again[-1][1])
        pixels_of.append((count[seen], rgba[pixels, :3][seen] / alpha, alpha[:, 0] ** 2))
        if known:
            shown = views["mask"][view].reshape(-1)[pixels[seen]]
            bases.append((
                views["albedo"][view].reshape(-1, 3)[pixels[seen]].astype(np.float32),
                shown * alpha[:, 0] ** 2,
            ))  # fmt: skip
    if sum(len(counts) for counts, _, _ in pixels_of) == 0:
        raise InputError("views", "no training view shows the object", "Render more views.")
    position, angles, surroundings, irradiance = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    count, colour, weight = (np.concatenate(column) for column in zip(*pixels_of, strict=True))
    appearance = Appearance(**views.attributes["appearance"])
    mirrored = [np.concatenate(column) for column in zip(*seen_again, strict=True)]
    base_colour, base_weight = (
        (np.concatenate(column) for column in zip(*bases, strict=True)) if known else (None, None)
    )
    return TrainingRays(
        position, angles, surroundings, irradiance, np.cumsum(count) - count, count, colour, weight,
        max(appearance.roughness**2, LEAST_ALPHA), appearance.metallic,
        MirrorRays(*mirrored) if mirrors else None, base_colour, base_weight,
    )  # fmt: skip


def _mirrored(
    surface: UnitSurface, face: np.ndarray, points: Incidence, light: np.ndarray, first: int
) -> tuple[np.ndarray, ...]:
    """Return the columns of `MirrorRays` for points on faces (n,), numbered from `first`."""
    hits = surface.mirrored(face, points)
    met = surface.incidence(hits.face, hits.barycentric, hits.direction, light)
    lit = np.flatnonzero(met.irradiance > 0)
    place = np.full(len(face), -1, dtype=np.int32)
    place[hits.row[lit]] = first + np.arange(len(lit), dtype=np.int32)
    row = hits.row[lit]
    camera = np.einsum("ij,ij->i", points.normal[row], points.to_camera[row])
    return (
        place,
        fifth_power_of_rim(camera)[:, None],
        met.position[lit].astype(np.float32),
        angle_inputs(met)[lit],
        met.irradiance[lit].astype(np.float32),
    )


def _inputs(points: Incidence, light: np.ndarray) -> tuple[np.ndarray, ...]:
    return (
        points.position.astype(np.float32),
        angle_inputs(points),
        surrounding_inputs(points, light),
        points.irradiance.astype(np.float32),
    )


def encoded_slope(linear: torch.Tensor) -> torch.Tensor:
    """Return the derivative of the sRGB encoding at linear values, those above 1 taken as 1."""
    safe = linear.clamp(SRGB_KNEE, 1.0)
    return torch.where(
        linear <= SRGB_KNEE, torch.full_like(linear, 12.92), 1.055 / 2.4 * safe ** (1 / 2.4 - 1)
    )


def display_loss(predicted: torch.Tensor, colour: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Mean squared error of the sRGB-encoded colour, linearised at the prediction.

    Linearised (as in RawNeRF, Mildenhall et al. 2022) because the encoding of a noisy value is darker
    in mean than the encoding of its mean. Both above 1 is no error: white is white.
    """
    over = (predicted > 1.0) & (colour > 1.0)
    error = (predicted - colour) * encoded_slope(predicted.detach()) * ~over
    return (error**2 * weight[:, None]).sum() / (3 * weight.sum()).clamp(min=1e-9)


def starting_albedo(rays: TrainingRays, radiance_scale: float) -> np.ndarray:
    """Return (3,) float32: grey, or the mean colour over the direct light where that is darker than `DARK`.

    A black surface is not found from grey: the gradients vanish on the way. A glossy
    surface is found worse from its mean, which holds its highlights.
    """
    arriving = np.add.reduceat(rays.irradiance, rays.first) / rays.count * radiance_scale
    shown = (rays.weight[:, None] * np.minimum(rays.colour, 1.0)).sum(axis=0)
    albedo = shown / max(float((rays.weight * arriving).sum()), 1e-9)
    return np.where(albedo.max() < DARK, np.maximum(albedo, 0.004), 0.5).astype(np.float32)


def train(
    grid: SparseGrid, rays: TrainingRays, *, radiance_scale: float, steps: int, batch_pixels: int,
    learning_rate: float, seed: int, priors: Priors,
) -> Reflectance:  # fmt: skip
    """Fit a network by Adam with a cosine schedule, where `objectfolder.making.device` says.

    The same seed gives the same weights on a processor. Others add gradients in any order, and differ as by
    another seed.
    """
    generator = torch.Generator().manual_seed(seed)
    random = np.random.default_rng(seed)
    network = Reflectance(grid.sizes, mirrors=rays.mirrored is not None)
    network.initialise(generator, rays.alpha, rays.metallic)
    with torch.no_grad():
        network.albedo.bias.copy_(torch.logit(torch.from_numpy(starting_albedo(rays, radiance_scale))))
    network.to(torch_device())
    tables = list(network.tables)
    known = {id(table) for table in tables}
    others = [parameter for parameter in network.parameters() if id(parameter) not in known]
    optimisers = [(Adam(tables), 4 * learning_rate), (Adam(others), learning_rate)]
    widths = [network.log_alpha, *([network.log_mirror_alpha] if network.mirrors else [])]
    order = np.empty(0, dtype=np.int64)
    for step in range(steps):
        if len(order) < batch_pixels:
            order = np.concatenate([order, random.permutation(len(rays.count))])
        batch, order = order[:batch_pixels], order[batch_pixels:]
        share = min(1.0, (step + 1) / 50) * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * step / steps)))
        loss = _loss(network, grid, rays, batch, radiance_scale, priors, random)
        loss.backward()
        for optimiser, rate in optimisers:
            optimiser.step(rate * share)
        with torch.no_grad():
            for width in widths:
                width.clamp_(min=math.log(LEAST_ALPHA))
    return network.cpu()


def _loss(
    network: Reflectance, grid: SparseGrid, rays: TrainingRays, batch: np.ndarray, radiance_scale: float,
    priors: Priors, random: np.random.Generator,
) -> torch.Tensor:  # fmt: skip
    count = rays.count[batch]
    owner = np.repeat(np.arange(len(batch)), count)
    row = (
        np.arange(len(owner))
        - np.repeat(np.cumsum(count) - count, count)
        + np.repeat(rays.first[batch], count)
    )
    place = network.log_alpha.device

    def on_device(values: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(values).to(place)

    angles = on_device(rays.angles[row])
    levels = network.levels(grid.interpolation(rays.position[row]))
    features = torch.cat(levels, dim=1)
    albedo = network.base(features, angles)
    radiance = network.radiance(
        levels,
        albedo,
        angles,
        on_device(rays.surroundings[row]),
        on_device(rays.irradiance[row]),
        None if rays.mirrored is None else _in_mirrors(network, grid, rays.mirrored, row),
    )

    def mean_of_pixels(values: torch.Tensor) -> torch.Tensor:
        total = torch.zeros(len(batch), 3, device=place).index_add(0, on_device(owner), values)
        return total / on_device(count.astype(np.float32))[:, None]

    loss = display_loss(
        mean_of_pixels(radiance) * radiance_scale,
        on_device(rays.colour[batch]),
        on_device(rays.weight[batch]),
    )
    if priors.base_colour > 0 and rays.base_colour is not None and rays.base_weight is not None:
        loss = loss + priors.base_colour * display_loss(
            mean_of_pixels(albedo),
            on_device(rays.base_colour[batch]),
            on_device(rays.base_weight[batch]),
        )
    if priors.evenness > 0:
        few = slice(0, EVEN_RAYS)
        # Under the light and the view of another point: the answer is to hold for all of them.
        others = on_device(random.permutation(len(angles[few])))
        loss = loss + priors.evenness * network.unevenness(features[few], angles[few][others])
    return loss


def _in_mirrors(network: Reflectance, grid: SparseGrid, mirrored: MirrorRays, row: np.ndarray) -> Mirrored:
    """Return what sub-rays `row` (n,) see in the surface."""
    place = mirrored.place[row]
    owner = np.flatnonzero(place >= 0)
    met, device = place[owner], network.log_alpha.device
    return Mirrored(
        torch.from_numpy(owner).to(device),
        torch.from_numpy(mirrored.rim[met]).to(device),
        torch.cat(network.levels(grid.interpolation(mirrored.position[met])), dim=1),
        torch.from_numpy(mirrored.angles[met]).to(device),
        torch.from_numpy(mirrored.irradiance[met]).to(device),
    )
