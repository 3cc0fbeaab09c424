"""Many sheared touches of an elastic gel at once, and the markers that move with it.

The problem is that of `objectfolder.touch.elastic.shear`. Steps have the length of Barzilai and Borwein, as
those of pressure have. After each, tractions within their limits that add up to the load are found by two
steps of Newton's method. The last step is as short as those of single queries, and tells the residual.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from objectfolder.batch import elastic_bodies, shear_bodies
from objectfolder.batch.elastic import Layer, Pressed
from objectfolder.batch.resident import upload
from objectfolder.batch.targets import Tensor, torch
from objectfolder.touch.elastic.markers import cells_at, image_middle, markers_at_rest, pixel_slope
from objectfolder.touch.elastic.shear import LEAST_SLOPE
from objectfolder.touch.elastic.tangential_influence import tangential_compliance
from objectfolder.touch.sensor.sensor import Sensor

# Boxes of cells round all contacts grow by this many rows and columns.
BOX_STEP = 32
LOAD_STEPS, SLIDING_STEPS = 2, 24
# The first step, over that of single queries.
FIRST_STEP = 3.0
# Tractions of a sliding object before they are cut, over the largest limit.
PUSHED = 1e3


@dataclass(frozen=True, eq=False)
class BatchMarkers:
    """k markers on the gels of n touches; the fields are those of `Markers`, on the device.

    ``rest_m`` (k, 3) and ``rest_pixels`` (k, 2) are of all touches, ``displacement_m`` (n, k, 3) and
    ``pixels`` (n, k, 2) of each.
    """

    rest_m: Tensor
    displacement_m: Tensor
    rest_pixels: Tensor
    pixels: Tensor
    radius_pixels: float

    def drawn_on(self, rgb: Tensor) -> Tensor:
        """Return images (n, height, width, 3) uint8 with a black dot at every marker, smooth at its rim."""
        pixels, drawn = self.pixels.to(torch.float32), torch.empty_like(rgb)
        # What is drawn of a dot begins half a pixel within its radius.
        radius = pixels.new_full((1,), self.radius_pixels - 0.5)
        shear_bodies.dot((len(rgb), rgb.shape[1] * rgb.shape[2]), pixels, radius, rgb, drawn)
        return drawn


@dataclass(frozen=True, eq=False)
class BatchShear:
    """Sheared contacts of n touches; the fields are those of `Shear`, on the device.

    ``shift_m`` is (n, 2), ``twist_rad``, ``sliding`` and ``relative_residual`` are (n,). Fields over cells
    are not kept; ``markers`` are what moves with them.
    """

    shift_m: Tensor
    twist_rad: Tensor
    sliding: Tensor
    relative_residual: Tensor
    markers: BatchMarkers


@dataclass(frozen=True, eq=False)
class Push:
    """Friction (n,), forces across (n, 2) and torques (n,) or None, as of `solve_shear`.

    Beside them the rows and columns of markers, see `moved_markers`, and steps.
    """

    friction: Tensor
    force_n: Tensor
    torque_nm: Tensor | None
    marker_grid: tuple[int, int] | None
    steps: int


class Compliance:
    """A `TangentialCompliance` on a device, of fields (n, rows, columns, 2)."""

    def __init__(self, layer: Layer, shape: tuple[int, int]) -> None:
        part, like = tangential_compliance(layer.gel, shape, layer.pitch), layer.grid
        self.shape, self._padded, self.greatest = shape, part._padded, part.greatest
        (xx, xy), (_, yy) = part._tractions
        self.least = float(((xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)).min())
        kind = like.cpu().numpy().dtype
        self._tractions = [upload(spectrum, like.device, kind) for spectrum in (xx, xy, yy)]
        self._pressure = [
            upload(spectrum, like.device, np.result_type(kind, 1j)) for spectrum in part._pressure
        ]

    def displacement(self, traction: Tensor, pressure: Tensor | None = None) -> Tensor:
        """Metres by tractions and, where they are given, pressures (n, rows, columns)."""
        xx, xy, yy = self._tractions
        first, second = torch.fft.rfft2(traction, self._padded, (1, 2)).unbind(-1)
        moved = [xx * first + xy * second, xy * first + yy * second]
        if pressure is not None:
            pressed = torch.fft.rfft2(pressure, self._padded)
            moved = [part + spectrum * pressed for part, spectrum in zip(moved, self._pressure, strict=True)]
        rows, columns = self.shape
        return torch.fft.irfft2(torch.stack(moved, -1), self._padded, (1, 2))[:, :rows, :columns].contiguous()


class GelShear:
    """The gel of a sensor with its markers on a device, sheared by Coulomb's law.

    Parameters
    ----------
    sensor, layer, push
        Whose gel, its cells, and by what all touches are sheared.
    compliance
        Of a part of the cells, by its rows and columns.

    Raises
    ------
    QueryError
        As `moved_markers`.
    """

    def __init__(
        self, sensor: Sensor, layer: Layer, push: Push, compliance: Callable[[tuple[int, int]], Compliance]
    ) -> None:
        self._layer, self._push, self._compliance, like = layer, push, compliance, layer.grid
        rest, pixels, radius = markers_at_rest(sensor, push.marker_grid)
        across = 2 * cells_at(sensor, rest, layer.shape) / np.subtract(layer.shape, 1)[:, None] - 1
        self._places = upload(across[::-1].T[None, None], like.device).to(like.dtype)
        places = rest, pixels, sensor.camera_position_m, image_middle(sensor)
        self._rest, self._rest_pixels, self._eye, self._middle = (
            upload(part, like.device, np.float64) for part in places
        )
        self._radius, self._slope = radius, pixel_slope(sensor)

    def part(self, pressed: Pressed, touches: slice) -> tuple[Tensor, ...]:
        """Shear some of the touches, pressed by `Layer.press`; return what `joined` takes."""
        push, layer = self._push, self._layer
        friction, force = push.friction[touches], push.force_n[touches]
        torque = None if push.torque_nm is None else push.torque_nm[touches]
        pressure, displacement = (
            part.permute(0, 3, 1, 2).flatten(0, 1)[: len(force)]
            for part in (pressed.pressure_pa, pressed.displacement_m)
        )
        cells, shape = _box(pressure > 0)
        load = _Load(friction.to(pressure.dtype)[:, None, None] * pressure[cells], force, torque, layer)
        part = self._compliance(shape)
        sliding, motion = load.sliding()
        load.total.masked_fill_(sliding[:, None], 0)
        traction, change, residual = load.least_energy(part, push.steps)
        along = load.field(motion)
        size = torch.linalg.vector_norm(along, dim=-1, keepdim=True)
        slid = load.limit[..., None] * along / size.clamp_min(1e-30)
        traction = torch.where(sliding[:, None, None, None], slid, traction)
        # What sticks last is what has moved furthest.
        moved = (part.displacement(traction) * along).sum(-1) / (size[..., 0] ** 2).clamp_min(1e-30)
        furthest = torch.where(load.limit > 0, moved, 0.0).amax((1, 2))
        change = torch.where(sliding[:, None], furthest[:, None] * motion, change)
        whole = pressure.new_zeros((*pressure.shape, 2))
        whole[cells] = traction
        sideways = self._compliance(layer.shape).displacement(whole, pressure)
        change[:, 2] /= load.state[:, 6]
        fields = torch.cat([displacement[..., None], sideways.flip(-1)], -1).movedim(-1, 1)
        moved = torch.nn.functional.grid_sample(
            fields, self._places.expand(len(force), -1, -1, -1), padding_mode="border", align_corners=True
        )
        return moved[:, :, 0].movedim(1, 2).double(), change.double(), sliding, residual.double()

    def joined(self, parts: list[tuple[Tensor, ...]]) -> BatchShear:
        """Return sheared touches one behind the other."""
        inward, change, sliding, residual = (torch.cat(part) for part in zip(*parts, strict=True))
        away = self._rest - inward - self._eye
        pixels = self._middle - away[..., [2, 1]] / away[..., :1] / self._slope
        markers = BatchMarkers(self._rest, -inward, self._rest_pixels, pixels, self._radius)
        return BatchShear(change[:, :2], change[:, 2], sliding, residual, markers)


class _Load:
    """What the tractions of n touches bear, see `shear._Load`, and their cells' arms."""

    def __init__(self, limit: Tensor, force: Tensor, torque: Tensor | None, layer: Layer) -> None:
        self.limit, pitch = limit, layer.pitch
        self.pitch = limit.new_tensor(pitch)
        self.state = limit.new_zeros((len(limit), shear_bodies.STATE))
        self.free = 2 if torque is None else 3
        self.sum = limit.sum((1, 2)).clamp_min(1e-30)
        touching = (limit > 0).to(limit.dtype)
        self.cells = touching.sum((1, 2)).clamp_min(1)
        squared = torch.zeros_like(self.sum)
        for axis in (0, 1):
            place = torch.arange(limit.shape[1 + axis], device=limit.device) * pitch[axis]
            centre = (limit.sum(2 - axis) * place).sum(1) / self.sum
            squared += (touching.sum(2 - axis) * (place - centre[:, None]) ** 2).sum(1) / self.cells
            self.state[:, 4 + axis] = centre
        self.state[:, 6] = torch.where(squared > 0, squared.sqrt(), max(pitch))
        turning = torch.zeros_like(self.sum) if torque is None else torque / self.state[:, 6]
        total = torch.cat([force, turning[:, None]], 1) / (pitch[0] * pitch[1])
        self.total = total.to(limit.dtype)

    def field(self, motion: Tensor) -> Tensor:
        """Displacements (n, rows, columns, 2) by motions (n, 3): along both directions, and turning."""
        row, column = (
            torch.arange(size, device=motion.device) * pitch
            for size, pitch in zip(self.limit.shape[1:], self.pitch, strict=True)
        )
        turn = motion[:, 2:] / self.state[:, 6:7]
        down = motion[:, :1] - turn * (column - self.state[:, 5:6])
        right = motion[:, 1:2] + turn * (row - self.state[:, 4:5])
        return torch.stack(torch.broadcast_tensors(down[:, None], right[:, :, None]), -1)

    def sliding(self) -> tuple[Tensor, Tensor]:
        """Whether loads (n,) are not borne, and unit motions (n, 3) with which objects slide under them.

        Friction takes least work of that motion, of those by which the load does as much. A motion under
        springs that hold it as friction held the one before takes less than that one (E. Weiszfeld 1937,
        Tohoku Math. J. 43).
        """
        most = PUSHED * self.limit.amax((1, 2))
        motion = _unit(self.total)
        still = self.limit.new_zeros((*self.limit.shape, 2))
        self.state[:, 1:4] = most[:, None] * motion
        _, curvature = self._balance(still, still)
        for _ in range(0 if self.free == 2 else SLIDING_STEPS):
            motion = _unit(self._solved(curvature, self.total))
            self.state[:, 1:4] = most[:, None] * motion
            _, curvature = self._balance(still, still)
        # Not a product of matrices, which a caller may have asked for in TF32.
        taken = most * (motion[:, None] * curvature * motion[..., None]).sum((1, 2))
        work = (self.total * motion).sum(1)
        return (taken <= work) & (work > 0), motion

    def least_energy(self, part: Compliance, steps: int) -> tuple[Tensor, Tensor, Tensor]:
        """Tractions that bear the load, how far objects move (n, 3), and the residual (n,)."""
        state, (touches, _, columns) = self.state, self.limit.shape
        traction = self.limit[..., None] * self.field(self.total) / self.sum[:, None, None, None]
        displacement = part.displacement(traction)
        scale = displacement.abs().amax((1, 2, 3))
        change = torch.zeros_like(self.total)
        state[:, 0], state[:, 7] = FIRST_STEP / part.greatest, shear_bodies.SLIPPING
        sums = self.limit.new_empty((2 * touches, columns, 4))
        for step in range(steps):
            if step == steps - 1:
                state[:, 0] = 1 / part.greatest
            state[:, 1:4] = state[:, :1] * change
            for _ in range(LOAD_STEPS):
                slope, curvature = self._balance(traction, displacement)
                state[:, 1:4] -= self._solved(curvature, slope - self.total)
            change = state[:, 1:4] / state[:, :1]
            moved = torch.empty_like(traction)
            shear_bodies.restrain((touches, columns), *self._cells(traction, displacement), moved)
            if step == steps - 1:
                break
            displaced = part.displacement(moved)
            elastic_bodies.compare(
                (touches, 2 * columns), traction, displacement, moved, displaced, displaced, sums
            )
            work, squared = sums.sum(1)[:, :2].unflatten(0, (-1, 2)).sum(1).unbind(1)
            state[:, 0] = (work / squared.clamp_min(1e-30)).clamp(1 / part.greatest, 1 / part.least)
            traction, displacement = moved, displaced
        error = (moved - traction).abs().amax((1, 2, 3)) * part.greatest
        return moved, change, torch.where(scale > 0, error / scale.clamp_min(1e-30), 0.0)

    def _cells(self, traction: Tensor, displacement: Tensor) -> tuple[Tensor, ...]:
        return traction, displacement, self.limit, self.state, self.pitch

    def _balance(self, traction: Tensor, displacement: Tensor) -> tuple[Tensor, Tensor]:
        """Sums of the tractions that step and lift give (n, 3), and their change with the lift (n, 3, 3)."""
        count, _, columns = self.limit.shape
        sums = self.limit.new_empty((count, columns, shear_bodies.SUMS))
        shear_bodies.balance((count, columns), *self._cells(traction, displacement), sums)
        total = sums.sum(1)
        return total[:, :3], total[:, 3:].unflatten(1, (3, 3))

    def _solved(self, curvature: Tensor, slope: Tensor) -> Tensor:
        """Lifts (n, 3) by which sums change so much; without a torque nothing turns."""
        some, step = slice(self.free), torch.zeros_like(slope)
        eye = torch.eye(self.free, dtype=slope.dtype, device=slope.device)
        steep = curvature[:, some, some] + LEAST_SLOPE * self.cells[:, None, None] * eye
        # Without its check, which waits for the device.
        step[:, some] = torch.linalg.solve_ex(steep, slope[:, some, None])[0][..., 0]
        return step


def _unit(motion: Tensor) -> Tensor:
    return motion / torch.linalg.vector_norm(motion, dim=1, keepdim=True).clamp_min(1e-30)


def _box(touching: Tensor) -> tuple[tuple[Tensor, ...], tuple[int, int]]:
    """Indices of cells round each contact (n, rows, columns), as many for all as the largest needs."""
    places, sizes = [], []
    for axis, whole in enumerate(touching.shape[1:]):
        lines = touching.any(2 - axis)
        first, behind = (side.to(torch.uint8).argmax(1) for side in (lines, lines.flip(1)))
        needed = torch.where(lines.any(1), whole - behind - first, 0)
        size = min(-(-max(int(needed.max()), 1) // BOX_STEP) * BOX_STEP, whole)
        sizes.append(size)
        places.append(first.clamp_max(whole - size)[:, None] + torch.arange(size, device=first.device))
    rows, columns = places
    touch = torch.arange(len(touching), device=rows.device)[:, None, None]
    return (touch, rows[:, :, None], columns[:, None]), (sizes[0], sizes[1])
