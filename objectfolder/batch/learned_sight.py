"""Colours of points by the networks of learned objects, in bfloat16 with sums in single precision."""

from collections.abc import Mapping, Sequence

import numpy as np

from objectfolder.batch import learned_bodies
from objectfolder.batch.learned_bodies import LEVELS
from objectfolder.batch.resident import joined_records, upload
from objectfolder.batch.sight_bodies import SurfacePoints
from objectfolder.batch.sight_surfaces import Scene, Surfaces, room_for_rays
from objectfolder.batch.targets import Tensor, torch
from objectfolder.vision.compiled.network import LIGHT_INPUTS
from objectfolder.vision.network.network_layout import ANGLES, LAYER_WIDTH, MIRROR_WIDTH
from objectfolder.vision.visionnet.visionnet import VisionNet

# Of the matrices of networks, whose products are summed in single precision. Lamps far away and close to a
# surface are beyond the range of float16.
HALF = torch.bfloat16


class LearnedSight:
    """Feature grids and networks of the first objects of some surfaces.

    Parameters
    ----------
    surfaces
        Of all objects.
    nets
        The learned ones.
    """

    def __init__(self, surfaces: Surfaces, nets: Sequence[VisionNet]) -> None:
        self._surfaces, self._device = surfaces, (place := surfaces.device)
        grids = [grid for net in nets if (grid := net._grid) is not None]
        weights = [net._weights for net in nets]
        tables = [[own[f"tables.{level}"].astype(np.float32) for level in range(LEVELS)] for own in weights]
        records = [(*table, *grid.lookups) for table, grid in zip(tables, grids, strict=True)]
        offsets, *arrays = joined_records(records, range(2 * LEVELS), place)
        sides = [[grid.resolution >> (LEVELS - 1 - level) for level in range(LEVELS)] for grid in grids]
        self._grid = offsets, upload(sides, place), *arrays
        self._alpha2 = _widths(weights, "log_alpha", place)
        self._mirror_alpha2 = _widths(weights, MIRROR_WIDTH, place)
        self._networks = [Network(own, place) for own in weights]
        self._mirrors = upload([MIRROR_WIDTH in own for own in weights], place)
        self._any_mirrors = any(MIRROR_WIDTH in own for own in weights)

    def shade(self, scene: Scene, points: SurfacePoints, starts: Tensor, colours: Tensor) -> None:
        """Write the colours of rays that meet points; those of each object lie between two of `starts`."""
        answers = self._answered(scene, points, starts, self._alpha2)
        reflected = torch.zeros(
            (len(points.ray_of) if self._any_mirrors else 1, 3), dtype=torch.float32, device=self._device
        )
        if self._any_mirrors:
            rays = room_for_rays(len(points.ray_of), self._device)
            learned_bodies.mirror(
                len(points.ray_of), *points, scene.objects, *self._surfaces.volumes,
                self._surfaces.triangles[2], *rays,
            )  # fmt: skip
            met = self._surfaces.lit(scene, rays)
            mirrored = self._answered(scene, met, torch.searchsorted(met.ray_of, starts), self._mirror_alpha2)
            learned_bodies.reflect(len(met.ray_of), *met, scene.objects, self._mirrors, *mirrored, reflected)
        learned_bodies.colour(
            len(points.ray_of), *points, scene.objects, self._mirrors, self._surfaces.radiance, *answers,
            reflected, colours,
        )  # fmt: skip

    def _answered(
        self, scene: Scene, points: SurfacePoints, starts: Tensor, alpha2: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return answers (n, ANSWERS) of the networks, their inputs and the lobes (n,) of highlights."""
        count = len(points.ray_of)
        # Each row begins where products in half precision want it, and so does each object.
        inputs, lobe, answers = (
            torch.empty(shape, dtype=torch.float32, device=self._device)
            for shape in (
                (learned_bodies.PADDED_ROWS, _eights(count)), (count,), (count, learned_bodies.ANSWERS)
            )
        )  # fmt: skip
        lamps = scene.objects, scene.lights, _lamp_terms(scene.lights)
        learned_bodies.inputs(count, *points, *lamps, *self._grid, alpha2, inputs, lobe)
        ends = starts.tolist()
        for network, start, end in zip(self._networks, ends, ends[1:], strict=False):
            if start < end:
                first = start - start % 8
                answer = network.answer(inputs[:, first : _eights(end)].to(HALF).T)
                answers[start:end] = answer[start - first : end - first]
        return answers, inputs, lobe


class Network:
    """`reflectance.Reflectance` of one object in three products of matrices.

    Both perceptrons lie side by side in each. Albedo and mirrors, which have no hidden layers, go through
    those by their positive and their negative part.
    """

    def __init__(self, weights: Mapping[str, np.ndarray], device: torch.device) -> None:
        features, coarse = learned_bodies.FEATURE_ROWS, learned_bodies.COARSE_ROWS
        terms = np.arange(coarse, coarse + learned_bodies.POINT_ROWS + learned_bodies.LAMP_ROWS)
        of_lamp = terms[LIGHT_INPUTS]
        order = [*np.setdiff1d(terms, of_lamp), *of_lamp]
        direct, bounced = weights["direct.0.weight"], weights["bounced.0.weight"]
        pair, straight = 2 * LAYER_WIDTH, 6
        hidden = pair + 2 * straight + 4  # a multiple of 8
        # (inputs, outputs) of each product, then what it adds.
        first, second, third = (
            np.zeros((rows + 1, columns), dtype=np.float32)
            for rows, columns in (
                (learned_bodies.PADDED_ROWS, hidden), (hidden, hidden), (hidden, learned_bodies.ANSWERS)
            )
        )  # fmt: skip
        first[: direct.shape[1], :LAYER_WIDTH] = direct.T
        first[:coarse, LAYER_WIDTH:pair] = bounced[:, :coarse].T
        first[features + ANGLES : learned_bodies.INPUT_ROWS, LAYER_WIDTH:pair] = bounced[:, order].T
        first[-1, :pair] = np.concatenate([weights[f"{name}.0.bias"] for name in ("direct", "bounced")])
        positive, negative = pair + np.arange(straight), pair + straight + np.arange(straight)
        for index, name in enumerate(("albedo", "facing")):
            if f"{name}.weight" in weights:
                own, columns = weights[f"{name}.weight"].T, positive[3 * index : 3 * index + 3]
                first[: len(own), columns], first[-1, columns] = own, weights[f"{name}.bias"]
        first[:, negative] = -first[:, positive]
        rows = slice(0, LAYER_WIDTH), slice(LAYER_WIDTH, pair)
        answers = slice(0, learned_bodies.BOUNCED), slice(learned_bodies.BOUNCED, learned_bodies.ALBEDO)
        for name, some, shown in zip(("direct", "bounced"), rows, answers, strict=True):
            second[some, some], second[-1, some] = weights[f"{name}.2.weight"].T, weights[f"{name}.2.bias"]
            third[some, shown], third[-1, shown] = weights[f"{name}.4.weight"].T, weights[f"{name}.4.bias"]
        both_parts = np.concatenate([positive, negative])
        second[both_parts, both_parts] = 1
        columns = learned_bodies.ALBEDO + np.arange(straight)
        third[positive, columns], third[negative, columns] = 1, -1
        self._layers = [
            (upload(layer[-1], device).to(HALF), upload(layer[:-1], device).to(HALF))
            for layer in (first, second, third)
        ]

    def answer(self, inputs: Tensor) -> Tensor:
        """Return what it says (n, ANSWERS) of points with inputs (n, ROWS)."""
        first, second, third = self._layers
        hidden = torch._addmm_activation(first[0], inputs, first[1])
        return torch.addmm(third[0], torch._addmm_activation(second[0], hidden, second[1]), third[1])


def _eights(count: int) -> int:
    """Return the least multiple of 8 from a count on."""
    return -(-count // 8) * 8


def _lamp_terms(places: Tensor) -> Tensor:
    """Return the inputs (n, 12) float32 that depend on lamps at (n, 3) alone."""
    waves = [torch.sin(torch.pi * places), torch.cos(torch.pi * places), torch.sin(2 * torch.pi * places)]
    return torch.cat([places, *waves], dim=1).float()


def _widths(weights: list[dict[str, np.ndarray]], name: str, device: torch.device) -> Tensor:
    """Return squared GGX widths (objects,) float32; 1 where there is none."""
    logs = [np.float32(own[name]) if name in own else np.float32(0) for own in weights]
    return upload(np.exp(2 * np.array(logs, dtype=np.float32)), device)
