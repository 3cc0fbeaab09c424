"""AudioNet: the modes of an object as fields on its surface.

A mode answers a force at x by the projection of the force on its shape there: the three branches of the
papers, one for each direction of a unit force, are the three components of one vector field per mode. The
fields are coefficients of smooth functions on the stored surface (`smoothness_transform`) for a covariance
that knows walls and gaps (`surface_kernel`), rounded with one step for all modes and coded without loss
(`entropy_coding`). Everything a query needs is numpy.
"""

import lzma
from collections.abc import Mapping
from dataclasses import asdict
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.audio.audionet.entropy_coding import decode_integers
from objectfolder.audio.audionet.smoothness_transform import solve_triangular, triangular_factor
from objectfolder.audio.audionet.surface_kernel import KernelParameters, SurfaceKernel
from objectfolder.errors import FormatError
from objectfolder.products.store import Product
from objectfolder.products.stored_values import number, whole_number
from objectfolder.products.unpacking import unpack_lzma
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BARYCENTRIC_STEPS = 255
DETOUR_STEP = 2.0**-13  # of the object's size
MODE_TENSORS = ("eigenvalues", "dampings_per_s", "radiation_weights")
# Rows of one matrix product. A row's answer must not depend on how many others there are, and the order in
# which a product adds up may depend on its shape: every product has this one.
ROWS = 16
LZMA_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9}]
# Several times what any object has needed; a larger number in a file is no reason to set memory aside.
LARGEST_DIMENSIONS = 16
LARGEST_POINTS = 1 << 12
LARGEST_MODES = 1 << 12
LARGEST_COEFFICIENTS = 1 << 22
LARGEST_VALUE = 1e15  # of an eigenvalue: 5 MHz
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

    @property
    def frequencies_hz(self) -> Floats:
        """Damped frequencies (modes,), hertz; 0 where a mode does not ring."""
        return np.sqrt(np.maximum(self.eigenvalues - self.dampings_per_s**2, 0.0)) / (2 * np.pi)

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
        try:
            points = whole_number("audio.control_points", metadata["control_points"], 0, LARGEST_POINTS)
            modes = whole_number(
                "audio.modes", metadata["modes"], 0, LARGEST_COEFFICIENTS // max(1, 3 * points)
            )
            dimensions = whole_number(
                "audio.detour_dimensions", metadata["detour_dimensions"], 0, LARGEST_DIMENSIONS
            )
            kernel = asdict(KernelParameters(**metadata["kernel"]))
            for name, value in kernel.items():
                number(f"audio.kernel.{name}", value, *KERNEL_RANGES[name])
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError(
                "Object File", f"audio metadata: {type(error).__name__} {error}", "Make it again."
            ) from error
        expected: dict[str, tuple[tuple[int | None, ...], type]] = {
            "control_faces": ((points,), np.int32),
            "control_barycentric": ((points, 2), np.uint8),
            "detours": ((None,), np.uint8),
            "coefficients": ((None,), np.uint8),
            "step": ((1,), np.float64),
            **{name: ((modes,), np.float64) for name in MODE_TENSORS},
        }
        known: dict[str, np.ndarray] = {}
        for name, (shape, kind) in expected.items():
            tensor = tensors.get(f"audio.{name}")
            if tensor is None:
                raise FormatError("Object File", f"no tensor audio.{name}", "Make it again.")
            fits = len(shape) == tensor.ndim and all(
                size in (None, found) for size, found in zip(shape, tensor.shape, strict=True)
            )
            if not fits or tensor.dtype != kind:
                raise FormatError(
                    "Object File",
                    f"tensor audio.{name} is {tensor.dtype} {tensor.shape}, not {np.dtype(kind)} {shape}",
                    "Make it again.",
                )
            known[f"audio.{name}"] = tensor
        for name in (*MODE_TENSORS, "step"):
            values = known[f"audio.{name}"]
            if not ((values >= 0) & (values <= LARGEST_VALUE)).all():
                finding = f"audio.{name} is negative, not finite or above {LARGEST_VALUE:g}"
                raise FormatError("Object File", finding, "Make it again.")
        faces = known["audio.control_faces"]
        if len(faces) and (faces.min() < 0 or faces.max() >= len(surface.faces)):
            raise FormatError("Object File", "audio.control_faces names faces that are not there")
        corners = known["audio.control_barycentric"].astype(np.int64)
        if (corners.sum(axis=1) > BARYCENTRIC_STEPS).any():
            raise FormatError("Object File", "audio.control_barycentric lies outside of its face")
        decode_detours(known["audio.detours"], len(surface.vertices), dimensions, 1.0)
        net = cls(known, metadata, surface)
        _ = net._quantised
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
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        modes = len(self.eigenvalues)
        result = np.zeros((len(points), 3 * modes))
        if modes and len(points):
            centres, weights = self._prepared
            nearest = self._surface.closest_points(points)
            features = self._kernel.features(nearest.face, nearest.barycentric)
            block = np.zeros((ROWS, features.shape[1]))
            for start in range(0, len(points), ROWS):
                count = min(ROWS, len(points) - start)
                block[:count] = features[start : start + count]
                result[start : start + count] = (self._kernel.covariance(block, centres) @ weights)[:count]
        return result.reshape(len(points), 3, modes)

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
        columns = 3 * len(self.eigenvalues)
        return decode_integers(
            self._tensors["audio.coefficients"], int(self._metadata["control_points"]), columns
        )

    @cached_property
    def _prepared(self) -> tuple[Floats, Floats]:
        """Features of the control points, and the weights (control points, 3 modes) of their covariances."""
        faces = self._tensors["audio.control_faces"].astype(np.int64)
        centres = self._kernel.features(
            faces, control_barycentric(self._tensors["audio.control_barycentric"])
        )
        factor = triangular_factor(self._kernel.covariance(centres, centres), self._kernel.parameters.ridge)
        coefficients = self._quantised * float(self._tensors["audio.step"][0])
        return centres, solve_triangular(factor, coefficients)


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
    if np.abs(steps).max(initial=0) >= 1 << 14:
        raise ValueError("detours are longer than twice the object")
    change = np.diff(steps, axis=0, prepend=0).astype("<i2").T
    high_and_low = np.ascontiguousarray(change).view(np.uint8).reshape(-1, 2).T
    packed = lzma.compress(high_and_low.tobytes(), lzma.FORMAT_RAW, filters=LZMA_FILTERS)
    return np.frombuffer(packed, dtype=np.uint8).copy()


def decode_detours(stream: np.ndarray, vertices: int, dimensions: int, size: float) -> Floats:
    """Decode what `encode_detours` returned, (vertices, dimensions) metres.

    Raises
    ------
    FormatError
        A stream that is damaged or of another length.
    """
    try:
        unpacked = unpack_lzma(stream.tobytes(), LZMA_FILTERS, 2 * dimensions * vertices)
        high_and_low = np.frombuffer(unpacked, dtype=np.uint8).reshape(2, -1).T
        change = np.ascontiguousarray(high_and_low).view("<i2").reshape(dimensions, vertices).T
    except ValueError as error:
        raise FormatError("Object File", f"audio.detours: damaged ({error})", "Make it again.") from error
    return np.cumsum(change.astype(np.int64), axis=0) * (DETOUR_STEP * size)


def fit_audionet(
    surface: Surface,
    modes: Product,
    *,
    goal_db: float = -42.0,
    most_bytes: int = 300_000,
) -> AudioNet:
    """Fit the fields of gains to the training points of solved modes.

    Parameters
    ----------
    surface
        As it is stored in the Object File.
    modes
        Product of `simulate_modes`; held-out points are not read.
    goal_db
        Relative rms error of gains over points, directions and modes, 20 log10, at training points that are
        left out for it.
    most_bytes
        Bound of all audio tensors; where it binds, the rounding step grows until they fit.

    Raises
    ------
    ValueError
        Bytes that do not hold even the frequencies.
    """
    from objectfolder.audio.audionet.fitting import fit_fields

    count = len(modes["eigenvalues"])
    fields = fit_fields(surface, modes, goal_db=goal_db, most_bytes=most_bytes - 3 * 8 * count - 8)
    tensors = {
        **{f"audio.{name}": tensor for name, tensor in fields.tensors.items()},
        **{f"audio.{name}": np.array(modes[name], dtype=np.float64) for name in MODE_TENSORS},
    }
    metadata = {
        "audible": count > 0,
        "modes": count,
        "control_points": len(fields.tensors["control_faces"]),
        "detour_dimensions": fields.detour_dimensions,
        "kernel": asdict(fields.kernel),
        "training_points": int((~modes["held_out"]).sum()),
        "validation_error_db": fields.validation_error_db,
        "frequency_limit_hz": modes.attributes["stated_frequency_limit_hz"],
        "amplitude": "impulse N s -> rms surface velocity along the normal, m/s",
    }
    return AudioNet(tensors, metadata, surface)
