"""Many touches of an elastic gel at once: pressures by projected gradients, and the deformed gel's image.

Of all pressures >= 0 whose sum is at most that of the asked force, the right one has the least energy at the
greatest indentation. Its gradient is the gap left. Steps have the length of Barzilai and Borwein (1988, IMA
J. Numer. Anal. 8), as Dai and Fletcher (2006, Math. Program. 106) take them under one linear condition: a
step costs one displacement, and takes no decision that differs from touch to touch.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.batch import elastic_bodies
from objectfolder.batch.elastic_bodies import FACE_SLACK, NOTHING_M
from objectfolder.batch.resident import upload
from objectfolder.batch.targets import Tensor, torch
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.influence import compliance
from objectfolder.touch.presses.elastic_press import _cells
from objectfolder.touch.sensor.camera import DEPTH_STEPS_PER_M, ray_grid
from objectfolder.touch.sensor.gel import gel_constants
from objectfolder.touch.sensor.sensor import Sensor

# Of the depth, how far above the gel faces count: it bulges by less.
BULGE_MARGIN = 1.5
# Touches that are solved together, which bounds the memory, 2.5 MB each on 192 x 128 cells.
TOUCHES_AT_ONCE = 1024
SHIFTS, HALVINGS = 2, 10


@dataclass(frozen=True, eq=False)
class Pressed:
    """Pressures and displacements of touches in pairs, and (n,) of each: indentation, force, residual."""

    pressure_pa: Tensor
    displacement_m: Tensor
    indentation_m: Tensor
    force_n: Tensor
    relative_residual: Tensor


class Layer:
    """The gel as cells on a device.

    Parameters
    ----------
    sensor, cell_m
        As of `elastic_press.press_elastic`.
    device
        Where it is.
    kind
        Type of all numbers, float32 or float64.

    Raises
    ------
    QueryError
        Cells that are not positive, or larger than half the gel.
    """

    def __init__(self, sensor: Sensor, cell_m: float, device: torch.device, kind: Any) -> None:
        self.shape = rows, columns = _cells(sensor, cell_m)
        self.pitch = pitch = sensor.gel_height_m / rows, sensor.gel_width_m / columns
        gel = Elastomer(sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio, sensor.gel_thickness_m)
        self.gel = gel
        part = compliance(gel, self.shape, pitch, self.shape)
        self.padded = part._padded
        half = part._spectrum
        # Of a kernel that is even along both axes.
        whole = np.concatenate([half, half[:, 1 : self.padded[1] - half.shape[1] + 1][:, ::-1]], axis=1)
        self._softest, self._stiffest = float(whole.max()), float(whole.min())
        self._spectrum = upload(whole / whole.size, device, kind)
        self._cell, self._modulus = pitch[0] * pitch[1], gel.contact_modulus_pa
        self.type = self._spectrum.dtype
        centre = [sensor.gel_width_m / 2 - pitch[1] / 2, sensor.gel_height_m / 2 - pitch[0] / 2]
        constants = gel_constants(sensor)
        near = constants[8] - constants[0]
        self.grid = upload([*centre, -pitch[1], -pitch[0], columns, rows], device, kind)
        self.form = upload([*constants[5:7], near, FACE_SLACK[kind]], device, kind)

    def room(self, pairs: int) -> tuple[Tensor, Tensor]:
        """Complex zeros (pairs, padded rows, padded columns), and the cells of both touches in them."""
        numbers = torch.zeros((pairs, *self.padded, 2), dtype=self.type, device=self._spectrum.device)
        return torch.view_as_complex(numbers), self._cells_of(numbers)

    def _cells_of(self, numbers: Tensor) -> Tensor:
        return numbers[:, : self.shape[0], : self.shape[1]]

    def displacement(self, pressure: Tensor) -> Tensor:
        """Displacements (pairs, rows, columns, 2), metres, by complex pressures with zeros round them."""
        spectrum = torch.fft.fft2(pressure)
        spectrum *= self._spectrum
        return self._cells_of(torch.view_as_real(torch.fft.ifft2(spectrum, norm="forward")))

    def gaps_and_slopes(self, starts: Tensor, windows: Tensor, forms: Tensor) -> tuple[Tensor, Tensor]:
        """Gaps (pairs, rows, columns, 2) and slopes (n, rows, columns, 2) of objects over the cells."""
        (rows, columns), count = self.shape, len(starts) - 1
        gaps = torch.full_like(forms[:1, :1], NOTHING_M).repeat(-(-count // 2), rows, columns, 2)
        slopes = forms.new_empty((count, rows, columns, 2))
        elastic_bodies.gap(
            (count, rows * columns), starts, windows, forms, self.grid, self.form, gaps, slopes
        )
        return gaps, slopes

    def press(self, gaps: Tensor, limit: Tensor, force: Tensor | None, steps: int) -> Pressed:
        """Press by forces (n,), or, without them, to the greatest indentations (n,) `limit`.

        Parameters
        ----------
        gaps
            (pairs, rows, columns, 2). Where n is odd, the last of a pair is not pressed.
        """
        limit = _paired(limit, self.type)
        if force is not None:
            force = _paired(force, self.type)
            # Without a force the gel stays where it meets the object.
            limit = torch.where(force > 0, limit, 0.0)
        pairs, lanes = len(gaps), 2 * self.shape[1]
        (field, pressure), (spare, moved) = self.room(pairs), self.room(pairs)
        total = None if force is None else force / self._cell
        state = torch.zeros((2 * pairs, 3), dtype=self.type, device=gaps.device)
        sums = torch.empty((2 * pairs, lanes // 2, 4), dtype=self.type, device=gaps.device)
        state[:, 0] = (self._softest * self._stiffest) ** -0.5
        reach = limit if force is None else self._estimate(gaps, limit, force)
        penetration = _lanes(reach) - gaps
        torch.clamp_min(penetration, 0, out=pressure)
        displacement = self.displacement(field)
        if total is None:
            factor = _sum(penetration * pressure) / _sum(displacement * pressure).clamp_min(1e-30)
        else:
            # A lane without pressure holds only roundings of its neighbour's displacement.
            loaded = _sum(pressure)
            factor = torch.where(loaded > 0, total / loaded, 0.0)
        pressure *= _lanes(factor)
        displacement *= _lanes(factor)
        touching = _sum(pressure > 0)
        gap_sum = _sum((displacement + gaps) * (pressure > 0))
        for step in range(steps + 1):
            if total is not None:
                reach = torch.where(
                    touching > 0, torch.minimum(gap_sum / touching.clamp_min(1), limit), limit
                )
            if step == steps:
                break
            state[:, 1] = reach
            state[:, 2] = 0
            for _ in range(SHIFTS):
                if total is None:
                    break
                # Newton's method on a convex function. The indentation is at most the greatest.
                elastic_bodies.exceed((pairs, lanes), pressure, displacement, gaps, state, sums)
                over, cells = sums[:, :, :2].sum(1).unbind(1)
                shift = state[:, 2] + (over - total) / cells.clamp_min(1)
                state[:, 2] = torch.maximum(shift, state[:, 0] * (reach - limit))
            elastic_bodies.descend((pairs, lanes), pressure, displacement, gaps, state, moved)
            displaced = self.displacement(spare)
            elastic_bodies.compare((pairs, lanes), pressure, displacement, moved, displaced, gaps, sums)
            work, squared, gap_sum, touching = sums.sum(1).unbind(1)
            state[:, 0] = (work / squared.clamp_min(1e-30)).clamp(1 / self._softest, 1 / self._stiffest)
            field, pressure, spare, moved = spare, moved, field, pressure
            displacement = displaced
        return self._pressed(gaps, pressure, displacement, reach)

    def _pressed(self, gaps: Tensor, pressure: Tensor, displacement: Tensor, reach: Tensor) -> Pressed:
        gap = displacement + gaps - _lanes(reach)
        wrong = torch.where(pressure > 0, gap.abs(), -gap)
        nearest = -_most(-gaps)
        scale = reach - nearest
        residual = torch.where(scale > 0, _most(wrong).clamp_min(0) / scale, 0.0)
        return Pressed(pressure, displacement, reach, _sum(pressure) * self._cell, residual)

    def _estimate(self, gaps: Tensor, limit: Tensor, force: Tensor) -> Tensor:
        """Indentations (n,) near those of forces: `contact_problem._indentation_estimate`, by bisection."""
        low, high = torch.minimum(-_most(-gaps), limit), limit
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            over = (_lanes(middle) - gaps).clamp_min(0)
            cells = _sum(over > 0).clamp_min(1)
            carried = 2 * self._modulus * _sum(over) * (self._cell / np.pi / cells).sqrt()
            low, high = torch.where(carried < force, middle, low), torch.where(carried < force, high, middle)
        return high


class ElasticView:
    """The camera's rays through a deformed gel, as `membrane.membrane_image` meets them.

    Parameters
    ----------
    look
        The fields of `pixels.Lamps`, or of `pixels.Table`.
    """

    def __init__(self, sensor: Sensor, samples: int, layer: Layer, look: tuple[Tensor, ...]) -> None:
        grid, kind, device = ray_grid(sensor, samples), layer.grid.cpu().numpy().dtype, look[0].device
        eye = np.append(np.subtract(sensor.camera_position_m, sensor.gel_apex_m), grid.near)
        shape = (len(grid.v), len(grid.u))
        visible = grid.u, grid.v, grid.gel_depth.reshape(shape), grid.gel_values.reshape(*shape, 3)
        rays, places = (
            [upload(part, device, kind) for part in parts]
            for parts in (visible, (eye, sensor.gel_apex_m, [DEPTH_STEPS_PER_M]))
        )
        self._pixels = sensor.image_height * sensor.image_width
        self._layer, self._body = layer, elastic_bodies.membrane_body(sensor.photometric_table is not None)
        self._constants = samples, *rays, layer.grid, layer.form, *places, *look

    def see(self, pressed: Pressed, slopes: Tensor, images: tuple[Tensor, Tensor, Tensor]) -> None:
        """Fill in rgb, depth and mask of touches whose objects lean by slopes (n, rows, columns, 2)."""
        count, rows, columns = slopes.shape[:3]
        fields = torch.empty((count, rows, columns, 4), dtype=slopes.dtype, device=slopes.device)
        elastic_bodies.deform(
            (count, rows * columns), pressed.pressure_pa, pressed.displacement_m, slopes, self._layer.grid,
            self._layer.form, fields,
        )  # fmt: skip
        self._body((count, self._pixels), fields, *self._constants, *images)


def _paired(values: Tensor, kind: torch.dtype) -> Tensor:
    return torch.nn.functional.pad(values.to(kind), (0, len(values) % 2))


def _lanes(values: Tensor) -> Tensor:
    """Numbers (n,) of touches beside those of their cells."""
    return values.reshape(-1, 1, 1, 2)


def _sum(values: Tensor) -> Tensor:
    return values.sum((1, 2), dtype=None if values.is_floating_point() else torch.float32).flatten()


def _most(values: Tensor) -> Tensor:
    return values.amax((1, 2)).flatten()
