"""Fitting AudioNet: where control points go, how many there are, how finely coefficients are rounded.

Every eighth training point checks the fits; the last fit is to all of them.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtrmm
from scipy.spatial import cKDTree

from objectfolder.audio.audionet.audionet import (
    BARYCENTRIC_STEPS,
    DETOUR_STEP,
    control_barycentric,
    encode_detours,
    size_of,
)
from objectfolder.audio.audionet.detours import detour_coordinates, farthest_points
from objectfolder.audio.audionet.entropy_coding import encode_integers
from objectfolder.audio.audionet.smoothness_transform import solve_triangular, triangular_factor
from objectfolder.audio.audionet.surface_kernel import KernelParameters, SurfaceKernel
from objectfolder.products.store import Product
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

CONTROL_POINTS = (60, 120, 240, 400, 640, 1000, 1500, 2000, 3000)
# Where so many fill more than this share of the bytes, more of them cost what they bring.
MANY, ROOM_USED = 2000, 0.7
# So many control points are spread evenly; more go where the fit to these is worst.
SPREAD = 640
# The local error of a fit is the mean over so many training points.
NEIGHBOURS = 8
# Control points for which kernels are compared.
COMPARED = 320
POINTS_COMPARED = 3000
# More control points than a quarter of the training points fit the points rather than the field between;
# more than six points a control add next to nothing.
LEAST_POINTS_A_CONTROL, MOST_POINTS_A_CONTROL = 4, 6
CHECK_EVERY = 8
DETOUR_DIMENSIONS = 5
# Detours narrower than this share of the object's size part nothing.
NARROW_DETOUR = 0.01
# A detour coordinate much narrower than the widest is not worth its bytes.
SHARE_OF_WIDEST = 0.15
# In the spread of control points a turn of the normal counts as this share of the object's size.
NORMAL_REACH = 0.03
# Rounding up from 0.6 rather than 0.5 saves more bytes than a finer step would cost for the same error.
ROUND_UP_FROM = 0.6
# Of the error at the goal the rounding may make up so much.
ROUNDING_SHARE = 0.5
# Where the goal is not met, the rounding may be this share of the error, which makes it 3 % larger.
ROUNDING_SHARE_SHORT = 0.25
# Variance of what training values have beyond the kernel's fields, of a kernel of variance 1: it holds
# functions that hardly any point has seen.
NOISE = 1e-5


@dataclass(frozen=True)
class Fields:
    """What is stored of the fields: tensors without prefix, kernel, and the error at the checked points."""

    tensors: dict[str, np.ndarray]
    kernel: KernelParameters
    detour_dimensions: int
    validation_error_db: float | None


@dataclass(frozen=True)
class Data:
    """Training points on the stored surface: face (n,), barycentric (n, 3), values (n, columns)."""

    face: Integers
    barycentric: Floats
    values: Floats

    def part(self, chosen: Flags | Integers) -> "Data":
        """Some of the points."""
        return Data(self.face[chosen], self.barycentric[chosen], self.values[chosen])


def fit_fields(surface: Surface, modes: Product, *, goal_db: float, most_bytes: int) -> Fields:
    """Fit all mode shapes; parameters as for `fit_audionet`."""
    training = ~modes["held_out"]
    values = modes["mode_shapes"][training].astype(np.float64).reshape(int(training.sum()), -1)
    if values.size == 0:
        return _nothing()
    nearest = surface.closest_points(modes["points"][training])
    data = Data(nearest.face, nearest.barycentric, values)
    checked = np.arange(len(values)) % CHECK_EVERY == CHECK_EVERY - 1
    most = max(1, len(values) // LEAST_POINTS_A_CONTROL)
    detours, kernel = _choose_kernel(surface, data, checked, min(COMPARED, most))
    stream = encode_detours(detours, size_of(surface))

    goal = 10 ** (goal_db / 20)
    counts = sorted({min(count, most) for count in CONTROL_POINTS})
    tested, fitted = data.part(checked), data.part(~checked)
    place = _places(kernel, fitted)
    every = farthest_points(place, min(SPREAD, counts[-1], len(place)))
    squared_misfit = np.ones(len(place))
    error = None
    for count in counts:
        if count > len(every):
            every = _more_where_worst(place, every, squared_misfit, count)
        controls = _stored(fitted, every[:count])
        equations = _equations(kernel, controls, fitted)
        fit = _solve(*equations)
        if len(tested.values):
            residual = _predict(kernel, controls, fit, tested) - tested.values
            error = float(np.linalg.norm(residual) / np.linalg.norm(tested.values))
            if error <= goal * np.sqrt(1 - ROUNDING_SHARE):
                break
            if count >= MANY and _bytes_used(fit, ROUNDING_SHARE * error) > ROOM_USED * most_bytes:
                break
        if count >= len(every) and count < counts[-1]:
            misfit = _predict(kernel, controls, fit, fitted) - fitted.values
            squared_misfit = np.sum(misfit**2, axis=1)
    more = _equations(kernel, controls, tested)
    coefficients = _solve(equations[0] + more[0], equations[1] + more[1], equations[2])
    room = most_bytes - len(stream) - 6 * count
    allowed = max(np.sqrt(max(goal**2 - (error or 0.0) ** 2, 0.0)), ROUNDING_SHARE_SHORT * (error or 0.0))
    tested = tested if len(tested.values) else data
    # Control points are not spread by area alone: what a coefficient's error is on the surface is tried.
    factor = 1.0
    for _ in range(2):
        quantised, step = _quantise(coefficients, allowed / factor, room)
        change = quantised * step - coefficients
        rounding = np.linalg.norm(_predict(kernel, controls, change, tested)) / np.linalg.norm(tested.values)
        factor = max(float(rounding * np.linalg.norm(coefficients) / np.linalg.norm(change)), 0.1)
    reached = None if error is None else float(20 * np.log10(max(np.hypot(error, rounding), 1e-12)))
    face, two = controls
    tensors: dict[str, np.ndarray] = {
        "control_faces": face.astype(np.int32),
        "control_barycentric": two,
        "detours": stream,
        "coefficients": encode_integers(quantised),
        "step": np.array([step]),
    }
    return Fields(tensors, kernel.parameters, detours.shape[1], reached)


def _nothing() -> Fields:
    tensors: dict[str, np.ndarray] = {
        "control_faces": np.zeros(0, dtype=np.int32),
        "control_barycentric": np.zeros((0, 2), dtype=np.uint8),
        "detours": encode_detours(np.zeros((0, 0)), 1.0),
        "coefficients": np.zeros(0, dtype=np.uint8),
        "step": np.ones(1),
    }
    return Fields(tensors, KernelParameters(), 0, None)


def _choose_kernel(surface: Surface, data: Data, checked: Flags, count: int) -> tuple[Floats, SurfaceKernel]:
    """The kernel that checks best with few control points, with detours or without."""
    size = size_of(surface)
    coordinates, spread = detour_coordinates(surface, DETOUR_DIMENSIONS)
    wide = spread > max(NARROW_DETOUR * size, SHARE_OF_WIDEST * spread[0])
    coordinates = np.rint(coordinates[:, wide] / (DETOUR_STEP * size)) * (DETOUR_STEP * size)
    plain = np.zeros((len(surface.vertices), 0))
    candidates = [(plain, KernelParameters())]
    if wide.any():
        candidates.append((coordinates, replace(KernelParameters(), detour_weight=0.5)))
    every = max(1, len(data.values) // POINTS_COMPARED)
    few = np.arange(len(data.values)) // CHECK_EVERY % every == 0
    best: tuple[Floats, SurfaceKernel] | None = None
    least = np.inf
    for detours, parameters in candidates:
        kernel = SurfaceKernel(surface, detours, parameters)
        if len(candidates) == 1 or not (checked & few).any():
            return detours, kernel
        controls = _stored(data, farthest_points(_places(kernel, data), count))
        coefficients = _solve(*_equations(kernel, controls, data.part(few & ~checked)))
        tested = data.part(few & checked)
        error = np.linalg.norm(_predict(kernel, controls, coefficients, tested) - tested.values)
        # Detours cost bytes: they must be worth it.
        if error < 0.8 * least:
            best, least = (detours, kernel), float(error)
    assert best is not None
    return best


def _places(kernel: SurfaceKernel, data: Data) -> Floats:
    """Where the points are, (n, .): distances between them say how far control points are apart."""
    place = kernel.features(data.face, data.barycentric)
    reach = NORMAL_REACH * np.sqrt(7.0) / kernel.parameters.length
    place[:, :3] *= reach / np.sqrt(max(kernel.parameters.normal_weight, 1e-12))
    return place


def _more_where_worst(place: Floats, chosen: Integers, squared_misfit: Floats, count: int) -> Integers:
    """Points `chosen` and more up to `count`: each the largest distance to others x misfit^1/2."""
    near = cKDTree(place).query(place, min(NEIGHBOURS, len(place)))[1].reshape(len(place), -1)
    weight = np.sqrt(squared_misfit[near].mean(axis=1))
    return np.concatenate([chosen, farthest_points(place, count - len(chosen), weight, place[chosen])])


def _stored(data: Data, chosen: Integers) -> tuple[Integers, NDArray[np.uint8]]:
    """Faces (count,) and stored barycentric coordinates (count, 2) of some of the points."""
    two = np.floor(data.barycentric[chosen, :2] * BARYCENTRIC_STEPS).astype(np.uint8)
    return data.face[chosen], two


def _functions(kernel: SurfaceKernel, controls: tuple[Integers, NDArray[np.uint8]]) -> tuple[Floats, Floats]:
    """Features of the control points and the triangular factor of their covariance."""
    centres = kernel.features(controls[0], control_barycentric(controls[1]))
    return centres, triangular_factor(kernel.covariance(centres, centres), kernel.parameters.ridge)


def _equations(
    kernel: SurfaceKernel, controls: tuple[Integers, NDArray[np.uint8]], data: Data
) -> tuple[Floats, Floats, Floats]:
    """Normal matrix (controls, controls) and right side (controls, columns) of least squares, and its prior.

    The functions are orthonormal but for the sampling: single precision is more than enough for them.
    """
    centres, factor = _functions(kernel, controls)
    count = len(centres)
    data = data.part(
        np.arange(0, len(data.values), max(1, len(data.values) // (MOST_POINTS_A_CONTROL * count)))
    )
    inverse = solve_triangular(factor, np.eye(count))
    normal = np.zeros((count, count))
    right = np.zeros((count, data.values.shape[1]))
    for start in range(0, len(data.values), 2048):
        part = data.part(np.arange(start, min(start + 2048, len(data.values))))
        covariance = kernel.covariance(kernel.features(part.face, part.barycentric), centres)
        # covariance @ inverse, at half of the work: the inverse is upper triangular.
        rows = dtrmm(1.0, inverse.T, covariance.T, lower=1, overwrite_b=1).T
        single = rows.astype(np.float32)
        normal += single.T @ single
        right += rows.T @ part.values
    return normal, right, NOISE * inverse.T @ kernel.covariance(centres, centres) @ inverse


def _solve(normal: Floats, right: Floats, prior: Floats) -> Floats:
    """Coefficients (controls, columns)."""
    return np.asarray(np.linalg.solve(normal + prior, right))


def _predict(
    kernel: SurfaceKernel,
    controls: tuple[Integers, NDArray[np.uint8]],
    coefficients: Floats,
    data: Data,
) -> Floats:
    centres, factor = _functions(kernel, controls)
    weights = solve_triangular(factor, coefficients)
    result = np.empty((len(data.face), coefficients.shape[1]))
    for start in range(0, len(result), 4096):
        stop = start + 4096
        features = kernel.features(data.face[start:stop], data.barycentric[start:stop])
        result[start:stop] = kernel.covariance(features, centres) @ weights
    return result


def _bytes_used(coefficients: Floats, allowed: float) -> int:
    """Bytes of coefficients (controls, columns) rounded to the relative error allowed."""
    return len(encode_integers(_rounded(coefficients, _step(coefficients, allowed))))


def _step(coefficients: Floats, allowed: float) -> float:
    """The largest step of the relative error allowed."""
    allowed *= float(np.linalg.norm(coefficients))
    low, high = 0.0, float(np.abs(coefficients).max())
    for _ in range(40):
        step = (low + high) / 2
        if np.linalg.norm(_rounded(coefficients, step) * step - coefficients) <= allowed:
            low = step
        else:
            high = step
    return low if low > 0 else high


def _quantise(coefficients: Floats, allowed: float, room: int) -> tuple[Integers, float]:
    """Whole numbers (controls, columns) and their step: the relative error allowed, or more to fit."""
    step = _step(coefficients, allowed)
    if len(encode_integers(_rounded(coefficients, step))) <= room:
        return _rounded(coefficients, step), step
    low, high = step, step
    while len(encode_integers(_rounded(coefficients, high))) > room:
        if high > 4 * np.abs(coefficients).max():
            raise ValueError(f"{room} bytes are too few for {coefficients.shape[1]} columns of coefficients")
        low, high = high, 2 * high
    for _ in range(5):
        step = np.sqrt(low * high)
        if len(encode_integers(_rounded(coefficients, step))) <= room:
            high = step
        else:
            low = step
    return _rounded(coefficients, high), float(high)


def _rounded(coefficients: Floats, step: float) -> Integers:
    whole = np.floor(np.abs(coefficients) / step + (1 - ROUND_UP_FROM))
    return (np.sign(coefficients) * whole).astype(np.int64)
