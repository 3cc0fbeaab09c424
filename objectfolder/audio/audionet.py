"""AudioNet: the modes of an object as a field on its surface.

Mode shapes are interpolated from control points by a Gaussian-process mean with the kernel

    k(x, x') = matern_7/2(|x - x'| / l) (1 + g n . n')

of position x and surface normal n. The second factor lets the two sides of a wall move by a common part
plus a
part that turns with the normal, as the cross-section of a bent wall does; positions alone would need points
closer together than the wall is thick. Gains at the control points are the least-squares fit to all training
points, stored in 8 bits with one scale a mode and axis. Everything a query needs is numpy.
"""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.errors import FormatError
from objectfolder.geometry.surface import Surface
from objectfolder.store import Product

Floats = NDArray[np.float64]
KERNEL = {"length": 0.15, "normal_weight": 0.02, "ridge": 1e-5}
# In the spread of control points a turn of the normal counts as this share of the object's size.
NORMAL_REACH = 0.03
FIRST_CONTROL_POINTS = 200
TENSORS = ("control_points", "control_normals", "control_gains", "scales")
MODE_TENSORS = ("frequencies_hz", "dampings_per_s", "radiation_weights")


class AudioNet:
    """Frequencies, dampings and gains of an object's modes.

    Attributes
    ----------
    frequencies_hz, dampings_per_s : (modes,) float64, the solver's
    radiation_weights : (modes,) float64, kg^-1/2; see `strike`
    """

    def __init__(
        self, tensors: Mapping[str, np.ndarray], metadata: Mapping[str, Any], surface: Surface
    ) -> None:
        self._tensors = dict(tensors)
        self._metadata = dict(metadata)
        self._surface = surface
        self.frequencies_hz: Floats = tensors["audio.frequencies_hz"]
        self.dampings_per_s: Floats = tensors["audio.dampings_per_s"]
        self.radiation_weights: Floats = tensors["audio.radiation_weights"]

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
            A tensor that is missing, or of another shape or kind than the number of modes and points says.
        """
        own = {f"audio.{name}": tensors.get(f"audio.{name}") for name in (*TENSORS, *MODE_TENSORS)}
        missing = [name for name, tensor in own.items() if tensor is None]
        if missing:
            raise FormatError("Object File", f"no tensor {missing[0]}", "Make it again.")
        known = {name: tensor for name, tensor in own.items() if tensor is not None}
        try:
            modes, points = int(metadata["modes"]), int(metadata["control_points"])
            kernel = {key: float(metadata["kernel"][key]) for key in KERNEL}
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError("Object File", f"audio metadata lacks {error}", "Make it again.") from error
        expected: dict[str, tuple[tuple[int, ...], type]] = {
            "control_points": ((points, 3), np.float32),
            "control_normals": ((points, 3), np.float16),
            "control_gains": ((points, 3, modes), np.int8),
            "scales": ((3, modes), np.float32),
            **{name: ((modes,), np.float64) for name in MODE_TENSORS},
        }
        for name, (shape, kind) in expected.items():
            tensor = known[f"audio.{name}"]
            if tensor.shape != shape or tensor.dtype != kind:
                raise FormatError(
                    "Object File",
                    f"tensor audio.{name} is {tensor.dtype} {tensor.shape}, not {np.dtype(kind)} {shape}",
                    "Make it again.",
                )
        if min(kernel["length"], kernel["ridge"]) <= 0 or kernel["normal_weight"] < 0:
            raise FormatError("Object File", f"impossible audio kernel {kernel}", "Make it again.")
        return cls(known, metadata, surface)

    def gains(self, points: ArrayLike) -> Floats:
        """Mass-normalised mode shapes at points of the surface: the gain of each mode to an impulse there.

        Parameters
        ----------
        points
            (n, 3) metres, object frame, on the surface.

        Returns
        -------
        ndarray
            (n, 3, modes) float64, kg^-1/2. Each point is answered on its own, so batches equal single
            queries.
        """
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        modes = len(self.frequencies_hz)
        result = np.zeros((len(points), 3 * modes))
        if modes and len(points):
            centres, normals, coefficients = self._prepared
            for index, normal in enumerate(normals_of(self._surface, points)):
                row = self._kernel(points[index : index + 1], normal[None], centres, normals)
                result[index] = row[0] @ coefficients
        return result.reshape(len(points), 3, modes)

    @cached_property
    def _prepared(self) -> tuple[Floats, Floats, Floats]:
        """Control points, their normals, and the weights (control points, 3 modes) of the kernel."""
        centres = self._tensors["audio.control_points"].astype(np.float64)
        normals = self._tensors["audio.control_normals"].astype(np.float64)
        values = self._tensors["audio.control_gains"] * self._tensors["audio.scales"].astype(np.float64)
        gram = self._kernel(centres, normals, centres, normals)
        gram[np.diag_indices(len(gram))] += float(self._metadata["kernel"]["ridge"])
        return centres, normals, np.linalg.solve(gram, values.reshape(len(centres), -1))

    def _kernel(self, x: Floats, n: Floats, centres: Floats, normals: Floats) -> Floats:
        return kernel(x, n, centres, normals, self._metadata["kernel"], _size(self._surface))


def kernel(
    x: Floats, n: Floats, centres: Floats, normals: Floats, parameters: Mapping[str, float], size: float
) -> Floats:
    """Covariance (a, b) of points (a, 3) with normals and centres (b, 3) with normals; `size` in metres."""
    difference = [x[:, None, axis] - centres[None, :, axis] for axis in range(3)]
    squared = difference[0] ** 2 + difference[1] ** 2 + difference[2] ** 2
    r = np.sqrt(7 * squared) / (parameters["length"] * size)
    cosine = np.zeros_like(r)
    for axis in range(3):
        cosine += n[:, None, axis] * normals[None, :, axis]
    return (1 + r + 0.4 * r**2 + r**3 / 15) * np.exp(-r) * (1 + parameters["normal_weight"] * cosine)


def normals_of(surface: Surface, points: Floats) -> Floats:
    """Smooth unit normals (n, 3) of the surface where it is nearest to points."""
    nearest = surface.closest_points(points)
    return np.asarray(surface.normals_at(nearest.face, nearest.barycentric), dtype=np.float64)


def fit_audionet(
    surface: Surface,
    modes: Product,
    *,
    goal_db: float = -30.0,
    most_bytes: int = 900_000,
) -> AudioNet:
    """Fit the field of gains to the training points of solved modes.

    The number of control points grows by halves until points left out of the fit (every eighth training
    point) are met
    within `goal_db`, or gains would take more than `most_bytes`, or there is one for every two training
    points; the last fit is to all training points.

    Parameters
    ----------
    surface
        As it is stored in the Object File.
    modes
        Product of `simulate_modes`; held-out points are not read.
    goal_db
        Relative rms error of gains over points, directions and modes, 20 log10.
    most_bytes
        Bound of the stored gains.
    """
    frequencies = modes["frequencies_hz"]
    count = len(frequencies)
    training = ~modes["held_out"]
    points = modes["points"][training]
    shapes = modes["mode_shapes"][training].astype(np.float64).reshape(len(points), 3 * count)
    size = _size(surface)
    normals = normals_of(surface, points) if count else np.zeros_like(points)
    normals = normals.astype(np.float16).astype(np.float64)
    # More control points than half the training points fit the points rather than the field between them.
    most = min(-(-len(points) // 2), max(1, most_bytes // (3 * count))) if count else 0
    order = spread(np.concatenate([points, NORMAL_REACH * size * normals], axis=1), most)

    checked = np.arange(len(points)) % 8 == 7
    controls = min(FIRST_CONTROL_POINTS, most)
    reached = None
    while controls:
        chosen = order[:controls]
        values = _fit(points, normals, shapes, chosen, ~checked, size)
        error = _predict(points[checked], normals[checked], points[chosen], normals[chosen], values, size)
        error -= shapes[checked]
        if checked.any():
            ratio = float(np.linalg.norm(error) / np.linalg.norm(shapes[checked]))
            reached = float(20 * np.log10(max(ratio, 1e-12)))
        if controls == most or (reached is not None and reached <= goal_db):
            break
        controls = min(controls * 3 // 2, most)
    chosen = order[:controls]
    values = _fit(points, normals, shapes, chosen, np.full(len(points), True), size)
    scales = np.maximum(np.abs(values).max(axis=0, initial=0.0), 1e-30) / 127
    tensors = {
        "audio.control_points": points[chosen].astype(np.float32),
        "audio.control_normals": normals[chosen].astype(np.float16),
        "audio.control_gains": np.rint(values / scales).astype(np.int8).reshape(controls, 3, count),
        "audio.scales": scales.reshape(3, count).astype(np.float32),
        "audio.frequencies_hz": np.array(frequencies, dtype=np.float64),
        "audio.dampings_per_s": np.array(modes["dampings_per_s"], dtype=np.float64),
        "audio.radiation_weights": np.array(modes["radiation_weights"], dtype=np.float64),
    }
    metadata = {
        "audible": count > 0,
        "modes": count,
        "control_points": controls,
        "kernel": dict(KERNEL),
        "training_points": len(points),
        "validation_error_db": reached,
        "frequency_limit_hz": modes.attributes["stated_frequency_limit_hz"],
        "amplitude": "impulse N s -> rms surface velocity along the normal, m/s",
    }
    return AudioNet(tensors, metadata, surface)


def spread(features: Floats, count: int) -> NDArray[np.int64]:
    """Farthest-point order: indices (count,) such that any leading part of it is spread out."""
    chosen = np.zeros(count, dtype=np.int64)
    distance = np.full(len(features), np.inf)
    for step in range(1, count):
        distance = np.minimum(distance, np.sum((features - features[chosen[step - 1]]) ** 2, axis=1))
        chosen[step] = distance.argmax()
    return chosen


def _fit(
    points: Floats,
    normals: Floats,
    shapes: Floats,
    chosen: NDArray[np.int64],
    used: NDArray[np.bool_],
    size: float,
) -> Floats:
    """Gains at the chosen control points, (controls, columns): least squares over the used points."""
    centres, towards = points[chosen], normals[chosen]
    gram = kernel(centres, towards, centres, towards, KERNEL, size)
    lower = np.linalg.cholesky(gram + KERNEL["ridge"] * np.eye(len(gram)))
    cross = kernel(points[used], normals[used], centres, towards, KERNEL, size)
    whitened = np.linalg.solve(lower, cross.T)
    normal_matrix = whitened @ whitened.T + KERNEL["ridge"] * np.eye(len(gram))
    return lower @ np.linalg.solve(normal_matrix, whitened @ shapes[used])


def _predict(x: Floats, n: Floats, centres: Floats, normals: Floats, values: Floats, size: float) -> Floats:
    gram = kernel(centres, normals, centres, normals, KERNEL, size)
    gram += KERNEL["ridge"] * np.eye(len(gram))
    return kernel(x, n, centres, normals, KERNEL, size) @ np.linalg.solve(gram, values)


def _size(surface: Surface) -> float:
    """Longest side of the bounding box, metres."""
    return float(np.ptp(surface.bounds, axis=0).max())
