"""The way of each mode through the air, as an Object File has it: rounded multipoles, packed.

A multipole of order l is rounded so that neither the far field nor the field on the sphere round the object
is off by more than a share of what the mode has there: with h_l of the sphere the step is the lesser of
`far` and `near / |h_l|`. Orders are left out where all of it rounds to nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.air.multipoles import (
    SOUND_SPEED_M_S,
    Radiation,
    count_of,
    hankel,
    harmonics,
    order_for,
    orders_of,
)
from objectfolder.errors import FormatError, QueryError
from objectfolder.products.integer_coding import pack_integers, unpack_integers, unzigzag, zigzag
from objectfolder.products.stored_values import number, numbers

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.int64]
ROUNDING_ERROR = 0.005  # of rounding, relative, that is asked for
TRANSFER_BYTES = 100_000
TENSOR_PREFIX = "audio.transfer_"
TENSOR_NAMES = tuple(
    TENSOR_PREFIX + name for name in ("wavenumbers", "orders", "steps", "coefficients", "residuals")
)
LARGEST_M = 1e6
LARGEST_STEP = 1e15
WAVENUMBERS = (1e-3, 1e4)  # of a mode that rings
LARGEST_COEFFICIENTS = 1 << 22
TRANSFER_REMEDY = "Make it again."


@dataclass(frozen=True)
class AirTransfer:
    """From the velocity of each mode to the pressure anywhere outside of the sphere round the object.

    Attributes
    ----------
    centre_m, radius_m : of that sphere, object frame
    wavenumbers : (modes,) of the air at each mode, radians a metre; 0: it does not ring and is not heard
    orders : (modes,) highest order of each mode's multipoles
    steps : (modes, 2) what far and near fields are rounded to
    whole : (2 n,) multipoles of one mode after the other in steps, real and imaginary part
    residuals : (modes,) estimated relative error of the far field that was solved, rms over directions
    """

    centre_m: Floats
    radius_m: float
    wavenumbers: Floats
    orders: Integers
    steps: NDArray[np.float32]
    whole: Integers
    residuals: NDArray[np.float32]

    @classmethod
    def of(cls, radiation: Radiation, most_bytes: int = TRANSFER_BYTES) -> "AirTransfer":
        """Round multipoles, to `ROUNDING_ERROR` or as finely as `most_bytes` allow.

        Examples
        --------
        >>> import numpy as np
        >>> breathing = Radiation(np.zeros(3), 0.1, np.array([20.0]), np.ones((1, 1)) + 0j, np.zeros(1))
        >>> pressure = AirTransfer.of(breathing).pressures([1.0, 0.0, 0.0])
        >>> bool(abs(abs(pressure[0]) - 0.05 / np.sqrt(4 * np.pi)) < 1e-3)
        True
        """
        error = ROUNDING_ERROR
        while True:
            transfer = cls._rounded(radiation, error)
            if sum(tensor.nbytes for tensor in transfer.tensors().values()) <= most_bytes:
                return transfer
            error *= 1.25

    @classmethod
    def _rounded(cls, radiation: Radiation, error: float) -> "AirTransfer":
        modes = len(radiation.wavenumbers)
        orders, steps = np.zeros(modes, dtype=np.int64), np.zeros((modes, 2), dtype=np.float32)
        whole = []
        for mode, (k, multipoles) in enumerate(zip(radiation.wavenumbers, radiation.multipoles, strict=True)):
            order = 0
            if k > 0:
                highest = min(order_for(k * radiation.radius_m), int(np.sqrt(len(multipoles))) - 1)
                multipoles = multipoles[: count_of(highest)]
                near = np.abs(hankel(highest, np.array(k * radiation.radius_m)))[orders_of(len(multipoles))]
                # Errors of rounding are a step / sqrt(12) in each of two parts.
                share = error * np.sqrt(6 / len(multipoles))
                steps[mode] = share * np.linalg.norm(multipoles), share * np.linalg.norm(near * multipoles)
                step = np.minimum(steps[mode, 0], steps[mode, 1] / near)
                parts = np.rint(
                    np.stack([multipoles.real, multipoles.imag], axis=1) / np.maximum(step, 1e-30)[:, None]
                )
                nonzero = np.flatnonzero(parts.any(axis=1))
                order = int(orders_of(len(multipoles))[nonzero[-1]]) if len(nonzero) else 0
            orders[mode] = order
            whole.append(parts[: count_of(order)] if k > 0 else np.zeros((1, 2)))
        packed = np.concatenate([part.reshape(-1) for part in whole]) if whole else np.zeros(0)
        return cls(
            radiation.centre_m,
            radiation.radius_m,
            radiation.wavenumbers,
            orders,
            steps,
            packed.astype(np.int64),
            radiation.residuals.astype(np.float32),
        )

    def pressures(self, position_m: ArrayLike) -> Complexes:
        """Pressure (modes,) of each mode at a place, Pa for a unit of modal velocity (m/s kg^1/2).

        The real part is in phase with the velocity, the imaginary part a quarter of a period before it is
        positive, as exp(-i omega t) has it.

        Raises
        ------
        QueryError
            A place within the sphere round the object.
        """
        offset = np.asarray(position_m, dtype=np.float64) - self.centre_m
        distance = float(np.linalg.norm(offset))
        if not distance > self.radius_m:
            finding = f"{distance:.3g} m from the object's middle, within the sphere round it"
            raise QueryError("listener", finding, f"Listen from farther than {self.radius_m:.3g} m.")
        highest = int(self.orders.max(initial=0))
        radial = self._radial(distance, highest)
        shape = harmonics(highest, offset[None])[:, 0]
        on_sphere = self._radial(self.radius_m, highest)
        heard = np.zeros(len(self.orders), dtype=np.complex128)
        begin = 0
        for mode, order in enumerate(self.orders):
            count = count_of(int(order))
            degree = orders_of(count)
            pair = self.whole[2 * begin : 2 * (begin + count)].reshape(count, 2)
            begin += count
            if self.wavenumbers[mode] > 0:
                far, near = self.steps[mode].astype(np.float64)
                step = np.minimum(far, near / np.abs(on_sphere[degree, mode]))
                waves = radial[degree, mode] * shape[:count] * step
                heard[mode] = waves @ (pair[:, 0] + 1j * pair[:, 1])
        return heard

    def delayed(self, position_m: ArrayLike, delay_s: float) -> Complexes:
        """Return `pressures`, of a sound that is later by `delay_s` anyway."""
        turn = self.wavenumbers * SOUND_SPEED_M_S * delay_s
        return np.asarray(self.pressures(position_m) * np.exp(-1j * turn))

    def _radial(self, distance_m: float, highest: int) -> Complexes:
        """h_l(k r) (orders, modes); beyond a mode's own order, or of one that does not ring, not a number."""
        with np.errstate(all="ignore"):
            return hankel(highest, self.wavenumbers * distance_m)

    def tensors(self) -> dict[str, np.ndarray]:
        """Return what is stored, keys ``audio.transfer_*``."""
        stored: dict[str, np.ndarray] = {
            "wavenumbers": self.wavenumbers,
            "orders": self.orders.astype(np.uint8),
            "steps": self.steps,
            "coefficients": pack_integers(zigzag(self.whole)),
            "residuals": self.residuals,
        }
        return {TENSOR_PREFIX + name: tensor for name, tensor in stored.items()}

    def metadata(self) -> dict[str, Any]:
        """Return the JSON-able rest."""
        return {"centre_m": self.centre_m.tolist(), "radius_m": self.radius_m}

    @classmethod
    def from_tensors(
        cls, tensors: Mapping[str, np.ndarray], metadata: Mapping[str, Any], modes: int
    ) -> "AirTransfer":
        """Open what `tensors` and `metadata` hold, checking all of it.

        Raises
        ------
        FormatError
            A tensor that is missing, of another shape or kind, with values that cannot be, or damaged.
        """
        centre = numbers("audio.transfer.centre_m", metadata["centre_m"], (3,), LARGEST_M)
        radius = number("audio.transfer.radius_m", metadata["radius_m"], 1 / LARGEST_M, LARGEST_M)
        arrays = _arrays(tensors, modes)
        wavenumbers, orders = arrays["wavenumbers"], arrays["orders"].astype(np.int64)
        rings = wavenumbers > 0
        if not (
            (wavenumbers == 0) | ((wavenumbers >= WAVENUMBERS[0]) & (wavenumbers <= WAVENUMBERS[1]))
        ).all():
            raise FormatError(TENSOR_PREFIX + "wavenumbers", "out of range, or not finite", TRANSFER_REMEDY)
        allowed = [order_for(k * radius) if k > 0 else 0 for k in wavenumbers]
        count = int(((orders + 1) ** 2).sum())
        if (orders > allowed).any() or count > LARGEST_COEFFICIENTS:
            raise FormatError(TENSOR_PREFIX + "orders", f"above what {radius:.3g} m radiate", TRANSFER_REMEDY)
        for name, largest in (("steps", LARGEST_STEP), ("residuals", LARGEST_STEP)):
            if not ((arrays[name] >= 0) & (arrays[name] <= largest)).all():
                raise FormatError(TENSOR_PREFIX + name, "negative, not finite or too large", TRANSFER_REMEDY)
        try:
            whole = unzigzag(unpack_integers(arrays["coefficients"], 2 * count))
        except ValueError as error:
            raise FormatError(
                TENSOR_PREFIX + "coefficients", f"damaged ({error})", TRANSFER_REMEDY
            ) from error
        if (arrays["steps"][~rings] != 0).any() or np.abs(whole).max(initial=0) > LARGEST_STEP:
            raise FormatError(
                TENSOR_PREFIX + "coefficients", "too large, or of a mode that does not ring", TRANSFER_REMEDY
            )
        return cls(centre, radius, wavenumbers, orders, arrays["steps"], whole, arrays["residuals"])


def _arrays(tensors: Mapping[str, np.ndarray], modes: int) -> dict[str, np.ndarray]:
    """Return the tensors ``audio.transfer_*`` by the rest of their names, each of its shape and kind."""
    expected: dict[str, tuple[tuple[int, ...] | None, type]] = {
        "wavenumbers": ((modes,), np.float64),
        "orders": ((modes,), np.uint8),
        "steps": ((modes, 2), np.float32),
        "coefficients": (None, np.uint8),
        "residuals": ((modes,), np.float32),
    }
    arrays = {}
    for name, (shape, kind) in expected.items():
        tensor = tensors.get(TENSOR_PREFIX + name)
        if tensor is None or tensor.dtype != kind or (tensor.shape != shape if shape else tensor.ndim != 1):
            finding = "missing" if tensor is None else f"{tensor.dtype} {tensor.shape}"
            raise FormatError(
                TENSOR_PREFIX + name, f"{finding}, not {np.dtype(kind)} {shape or '(n,)'}", TRANSFER_REMEDY
            )
        arrays[name] = tensor
    return arrays
