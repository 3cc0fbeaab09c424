"""AudioNet: the modes of an object as fields on its surface.

A mode answers a force at x by the projection of the force on its shape there: the three branches of the
papers, one for each direction of a unit force, are the three components of one vector field per mode. The
fields are coefficients of smooth functions on the stored surface for a covariance that knows walls and gaps
(`surface_kernel`), rounded with one step for all modes and coded without loss. Everything a query needs is
numpy.
"""

import html
import reprlib
from collections.abc import Mapping
from dataclasses import asdict
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.audionet.surface_kernel import (
    KernelParameters,
    SurfaceKernel,
    solve_triangular,
    triangular_factor,
)
from objectfolder.errors import FormatError
from objectfolder.products.integer_coding import pack_integers, unpack_integers, unzigzag, zigzag
from objectfolder.products.matrix_coding import unpack_matrix
from objectfolder.products.stored_values import number, whole_number
from objectfolder.products.tensor_file import REMEDY
from objectfolder.surface.surface import ClosestPoints, Surface

if TYPE_CHECKING:
    from objectfolder.audio.air.transfer import AirTransfer

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LOSS_FACTOR, RAYLEIGH = "loss_factor", "rayleigh"
LAWS = (LOSS_FACTOR, RAYLEIGH)  # by which dampings are made
BARYCENTRIC_STEPS = 255
DETOUR_STEP = 2.0**-13  # of the object's size
MODE_TENSORS = ("eigenvalues", "dampings_per_s", "radiation_weights")
RADIATION = "radiation_dampings_per_s"  # not in a file whose radiation was not solved
# Rows of one matrix product. A row's answer must not depend on how many others there are, and the order in
# which a product adds up may depend on its shape: every product has this one.
PRODUCT_ROWS = 4
NOTEBOOK_MODES = 20  # modes in a notebook
# Several times what any object has needed; a larger number in a file is no reason to set memory aside.
LARGEST_DIMENSIONS = 16
LARGEST_POINTS = 3000  # no fit takes more
LARGEST_CORRECTIONS = 20_000  # no fit takes more
LARGEST_COEFFICIENTS = 1 << 22
LARGEST_VALUE = 1e15  # of an eigenvalue: 5 MHz
# A rigid motion has 1 everywhere; the light tip of a heavy body has more, the starter set 15 at most.
LARGEST_SHAPE = 1e3
KERNEL_RANGES = {
    "length": (1e-6, 1e6),
    "normal_weight": (0.0, 1e6),
    "detour_weight": (0.0, 1e6),
    "ridge": (1e-15, 1e6),
}


class AudioNet:
    """Eigenvalues, dampings and gains of an object's modes.

    Attributes
    ----------
    eigenvalues : (modes,) float64, rad^2/s^2: squared angular frequencies without damping
    dampings_per_s : (modes,) float64, decay rates of the amplitude; modes damped beyond the critical, with
        c^2 >= lambda, are among them
    radiation_weights : (modes,) float64, kg^-1/2: rms of the normal component over the surface
    radiation_dampings_per_s : (modes,) float64, what radiation has of `dampings_per_s`; None where it was not
        solved: the air is then in no decay
    transfer : the way of each mode through the air, None where it was not solved
    """

    def __init__(
        self, tensors: Mapping[str, np.ndarray], metadata: Mapping[str, Any], surface: Surface
    ) -> None:
        self._tensors = dict(tensors)
        self._metadata = dict(metadata)
        self._surface = surface
        self.eigenvalues: Floats = tensors["audio.eigenvalues"]
        self.dampings_per_s: Floats = tensors["audio.dampings_per_s"]
        self.radiation_weights: Floats = tensors["audio.radiation_weights"]
        self.radiation_dampings_per_s: Floats | None = tensors.get(f"audio.{RADIATION}")
        described = metadata.get("transfer")
        self.transfer = (
            None if described is None else _air_transfer(tensors, described, len(self.eigenvalues))
        )

    @property
    def frequencies_hz(self) -> Floats:
        """Damped frequencies (modes,), hertz; 0 where a mode does not ring."""
        return np.sqrt(np.maximum(self.eigenvalues - self.dampings_per_s**2, 0.0)) / (2 * np.pi)

    @property
    def loss_factors(self) -> Floats:
        """Loss factor of each mode (modes,): eta = 2 c / omega at its undamped frequency."""
        return 2 * self.dampings_per_s / np.sqrt(np.maximum(self.eigenvalues, 1e-300))

    @property
    def t60_s(self) -> Floats:
        """Time in which each mode falls by 60 dB (modes,), seconds; infinite without damping."""
        with np.errstate(divide="ignore"):
            return 3 * np.log(10) / self.dampings_per_s

    @property
    def damping(self) -> dict[str, Any]:
        """Law of the dampings, and its numbers; Rayleigh's where an older file states none."""
        return dict(self._metadata.get("damping") or {"law": RAYLEIGH})

    @property
    def absent(self) -> str | None:
        """Why the object has no sound at all; None where it has modes, or none in the band."""
        reason = self._metadata.get("absent")
        return None if reason is None else str(reason)

    def _repr_html_(self) -> str:
        """Return the lowest modes for a notebook: frequency, time in which it falls by 60 dB, loss factor."""
        listed = list(zip(self.frequencies_hz, self.t60_s, self.loss_factors, strict=True))[:NOTEBOOK_MODES]
        rows = "".join(f"<tr><td>{hertz:.1f}<td>{fall_s:.3g}<td>{eta:.2g}" for hertz, fall_s, eta in listed)
        summary = html.escape(self.absent or f"{len(self.frequencies_hz)} modes")
        return f"<div>{summary}</div><table><tr><th>Hz<th>T60, s<th>loss factor{rows}</table>"

    def tensors(self) -> dict[str, np.ndarray]:
        """Return what is stored, keys ``audio.*``."""
        return dict(self._tensors)

    def metadata(self) -> dict[str, Any]:
        """Return the JSON-able rest."""
        return dict(self._metadata)

    @classmethod
    def from_tensors(
        cls, tensors: Mapping[str, np.ndarray], metadata: Mapping[str, Any], surface: Surface
    ) -> "AudioNet":
        """Open what `tensors` and `metadata` hold.

        Raises
        ------
        FormatError
            A tensor that is missing, of another shape or kind than the number of modes and control points
            says, with values that cannot be, or damaged.
        """
        points, modes, dimensions = _counts(metadata)
        _check_damping(metadata.get("damping"))
        arrays = _tensors_of(tensors, points, modes)
        if metadata.get("transfer") is not None:
            from objectfolder.audio.air.transfer import TENSOR_NAMES as TRANSFER_TENSORS

            arrays.update((name, tensors[name]) for name in TRANSFER_TENSORS if name in tensors)
        for name in (*MODE_TENSORS, "step", RADIATION):
            values = arrays.get(f"audio.{name}", np.zeros(0))
            if not ((values >= 0) & (values <= LARGEST_VALUE)).all():
                finding = f"audio.{name} is negative, not finite or above {LARGEST_VALUE:g}"
                raise FormatError("Object File", finding, "Make it again.")
        if (arrays.get(f"audio.{RADIATION}", np.zeros(modes)) > arrays["audio.dampings_per_s"]).any():
            raise FormatError("Object File", f"audio.{RADIATION} is above the whole decay", "Make it again.")
        faces = arrays["audio.control_faces"]
        if len(faces) and (faces.min() < 0 or faces.max() >= len(surface.faces)):
            raise FormatError("Object File", "audio.control_faces names faces that are not there")
        corners = arrays["audio.control_barycentric"].astype(np.int64)
        if (corners.sum(axis=1) > BARYCENTRIC_STEPS).any():
            raise FormatError("Object File", "audio.control_barycentric lies outside of its face")
        decode_detours(arrays["audio.detours"], len(surface.vertices), dimensions, 1.0)
        net = cls(arrays, metadata, surface)
        _ = net._quantised, net._corrected
        return net

    def gains(self, points: ArrayLike) -> Floats:
        """Mass-normalised mode shapes at points of the surface: the gain of each mode to an impulse there.

        Parameters
        ----------
        points
            (n, 3) metres, object frame; each is answered at the nearest point of the surface. On an edge or
            a vertex the answers of the faces that meet there are one and the same.

        Returns
        -------
        ndarray
            (n, 3, modes) float64, kg^-1/2. Each point is answered on its own: a batch equals single
            queries but for rounding.
        """
        return self.gains_at(
            self._surface.closest_points(np.asarray(points, dtype=np.float64).reshape(-1, 3))
        )

    def gains_at(self, places: ClosestPoints) -> Floats:
        """Return the same where the places of the surface are known already."""
        count, modes = len(places.points), len(self.eigenvalues)
        result = np.zeros((count, 3 * modes))
        if modes and count:
            centres, weights = self._prepared
            features = self._kernel.features(places.face, places.barycentric)
            block = np.zeros((PRODUCT_ROWS, features.shape[1]))
            for start in range(0, count, PRODUCT_ROWS):
                rows = min(PRODUCT_ROWS, count - start)
                block[:rows] = features[start : start + rows]
                result[start : start + rows] = (self._kernel.covariance(block, centres) @ weights)[:rows]
            self._correct(result, places.face, places.barycentric)
        return result.reshape(count, 3, modes)

    def gains_of_mass(self, points: ArrayLike | ClosestPoints, mass_kg: float) -> Floats:
        """Return `gains`, or `gains_at`, but for those that no body of this mass has.

        Raises
        ------
        FormatError
            Such gains, or none.
        """
        try:
            gains = self.gains_at(points) if isinstance(points, ClosestPoints) else self.gains(points)
        except np.linalg.LinAlgError as error:
            raise FormatError("audio", f"its coefficients have no solution ({error})", REMEDY) from error
        largest = np.abs(gains).max(initial=0.0) * np.sqrt(mass_kg)
        radiating = self.radiation_weights.max(initial=0.0) * np.sqrt(mass_kg)
        if not (largest <= LARGEST_SHAPE and radiating <= LARGEST_SHAPE):
            finding = f"gains of {largest:.3g} and {radiating:.3g} over the root of the mass"
            raise FormatError("audio", f"{finding}, above {LARGEST_SHAPE:g}", REMEDY)
        return gains

    def _correct(self, result: Floats, face: Integers, barycentric: Floats) -> None:
        """Add corrections to fields (n, 3 modes) at barycentric coordinates (n, 3) of faces (n,)."""
        numbers = self._corrected
        values = self._quantised[len(self._quantised) - len(numbers) :]
        shares = barycentric * float(self._tensors["audio.step"][1])
        for vertex, share in zip(self._surface.faces[face].T, shares.T, strict=True):
            place = np.searchsorted(numbers, vertex)
            at = np.flatnonzero(np.append(numbers, -1)[place] == vertex)
            result[at] += share[at, None] * values[place[at]]

    def corrections(self) -> tuple[Integers, Floats]:
        """Return vertices (n,) that have a correction, and what it adds to `gains` there (n, 3, modes)."""
        values = self._quantised[len(self._quantised) - len(self._corrected) :]
        scaled = values * float(self._tensors["audio.step"][1])
        return self._corrected, scaled.reshape(len(values), 3, len(self.eigenvalues))

    @cached_property
    def _kernel(self) -> SurfaceKernel:
        detours = decode_detours(
            self._tensors["audio.detours"],
            len(self._surface.vertices),
            int(self._metadata["detour_dimensions"]),
            size_of(self._surface),
        )
        return SurfaceKernel(self._surface, detours, KernelParameters(**self._metadata["kernel"]))

    @cached_property
    def _quantised(self) -> Integers:
        """Coefficients of the control points, and below them the corrections."""
        rows = int(self._metadata["control_points"]) + int(self._metadata["corrections"])
        try:
            return unpack_matrix(self._tensors["audio.coefficients"], (rows, 3 * len(self.eigenvalues)))
        except ValueError as error:
            raise FormatError(
                "Object File", f"audio.coefficients: damaged ({error})", "Make it again."
            ) from error

    @cached_property
    def _corrected(self) -> Integers:
        """Vertices that have a correction, ascending."""
        gaps = _decoded(
            "audio.corrected", self._tensors["audio.corrected"], (1, int(self._metadata["corrections"]))
        )
        numbers = np.cumsum(gaps[0])
        if (gaps[0, 1:] <= 0).any() or (
            len(numbers) and not 0 <= numbers[0] <= numbers[-1] < len(self._surface.vertices)
        ):
            raise FormatError("Object File", "audio.corrected names vertices that are not there")
        return numbers

    @cached_property
    def _prepared(self) -> tuple[Floats, Floats]:
        """Features of the control points, and the weights (control points, 3 modes) of their covariances."""
        faces = self._tensors["audio.control_faces"].astype(np.int64)
        centres = self._kernel.features(
            faces, control_barycentric(self._tensors["audio.control_barycentric"])
        )
        factor = triangular_factor(self._kernel.covariance(centres, centres), self._kernel.parameters.ridge)
        coefficients = self._quantised[: len(faces)] * float(self._tensors["audio.step"][0])
        return centres, solve_triangular(factor, coefficients)


def _check_damping(stated: Any) -> None:
    """Refuse a law that is none; older files state none."""
    if stated is None:
        return
    if not (isinstance(stated, Mapping) and stated.get("law") in LAWS):
        finding = f"audio metadata: damping {reprlib.repr(stated)}"
        raise FormatError("Object File", finding, f"Its law is one of {', '.join(LAWS)}.")
    for name in set(stated) - {"law"}:
        number(f"audio.damping.{name}", stated[name], -LARGEST_VALUE, LARGEST_VALUE)


def _air_transfer(
    tensors: Mapping[str, np.ndarray], described: Mapping[str, Any], modes: int
) -> "AirTransfer":
    # Here and in `from_tensors`: few files need it, and with it SciPy, whose import takes 0.2 s.
    from objectfolder.audio.air.transfer import AirTransfer

    return AirTransfer.from_tensors(tensors, described, modes)


def _counts(metadata: Mapping[str, Any]) -> tuple[int, int, int]:
    """Control points, modes and detour dimensions that metadata say, with a kernel in its ranges."""
    try:
        points = whole_number("audio.control_points", metadata["control_points"], 0, LARGEST_POINTS)
        corrections = whole_number("audio.corrections", metadata["corrections"], 0, LARGEST_CORRECTIONS)
        most = LARGEST_COEFFICIENTS // max(1, 3 * (points + corrections))
        modes = whole_number("audio.modes", metadata["modes"], 0, most)
        dimensions = whole_number(
            "audio.detour_dimensions", metadata["detour_dimensions"], 0, LARGEST_DIMENSIONS
        )
        for name, value in asdict(KernelParameters(**metadata["kernel"])).items():
            number(f"audio.kernel.{name}", value, *KERNEL_RANGES[name])
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(
            "Object File", f"audio metadata: {type(error).__name__} {error}", "Make it again."
        ) from error
    return points, modes, dimensions


def _tensors_of(tensors: Mapping[str, np.ndarray], points: int, modes: int) -> dict[str, np.ndarray]:
    """The tensors ``audio.*``, each of its shape and type."""
    expected: dict[str, tuple[tuple[int | None, ...], type]] = {
        "control_faces": ((points,), np.int32),
        "control_barycentric": ((points, 2), np.uint8),
        "detours": ((None,), np.uint8),
        "coefficients": ((None,), np.uint8),
        "corrected": ((None,), np.uint8),
        "step": ((2,), np.float64),
        **{name: ((modes,), np.float64) for name in MODE_TENSORS},
    }
    if f"audio.{RADIATION}" in tensors:
        expected[RADIATION] = ((modes,), np.float64)
    arrays: dict[str, np.ndarray] = {}
    for name, (shape, kind) in expected.items():
        tensor = tensors.get(f"audio.{name}")
        if tensor is None:
            raise FormatError("Object File", f"no tensor audio.{name}", "Make it again.")
        fits = len(shape) == tensor.ndim and all(
            size in (None, extent) for size, extent in zip(shape, tensor.shape, strict=True)
        )
        if not fits or tensor.dtype != kind:
            raise FormatError(
                "Object File",
                f"tensor audio.{name} is {tensor.dtype} {tensor.shape}, not {np.dtype(kind)} {shape}",
                "Make it again.",
            )
        arrays[f"audio.{name}"] = tensor
    return arrays


def size_of(surface: Surface) -> float:
    """Longest side of the bounding box, metres."""
    return float(np.ptp(surface.bounds, axis=0).max())


def control_barycentric(stored: np.ndarray) -> Floats:
    """Barycentric coordinates (n, 3) of what is stored, (n, 2) uint8."""
    two = stored.astype(np.float64) / BARYCENTRIC_STEPS
    return np.concatenate([two, 1.0 - two.sum(axis=1, keepdims=True)], axis=1)


def encode_detours(detours: Floats, size: float) -> NDArray[np.uint8]:
    """Detour coordinates (vertices, dimensions) metres as bytes, to `DETOUR_STEP` of the object's size."""
    steps = np.rint(detours / (DETOUR_STEP * size)).astype(np.int64)
    return pack_integers(zigzag(np.diff(steps, axis=0, prepend=0).T))


def decode_detours(stream: np.ndarray, vertices: int, dimensions: int, size: float) -> Floats:
    """Decode what `encode_detours` returned, (vertices, dimensions) metres.

    Raises
    ------
    FormatError
        A stream that is damaged or of another length.
    """
    change = _decoded("audio.detours", stream, (dimensions, vertices))
    return np.cumsum(change.T, axis=0) * (DETOUR_STEP * size)


def _decoded(name: str, stream: np.ndarray, shape: tuple[int, int]) -> Integers:
    try:
        return unzigzag(unpack_integers(stream, shape[0] * shape[1])).reshape(shape)
    except ValueError as error:
        raise FormatError("Object File", f"{name}: damaged ({error})", "Make it again.") from error
