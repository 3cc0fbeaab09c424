"""Fitting AudioNet: where control points go, how many there are, how finely coefficients are rounded.

Of sixteen training points two choose among fits and one judges the choice; the last fit is to all of them.
"""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from objectfolder.audio.air.multipoles import radiation_of
from objectfolder.audio.air.transfer import AirTransfer
from objectfolder.audio.audionet.audionet import (
    BARYCENTRIC_STEPS,
    DETOUR_STEP,
    MODE_TENSORS,
    AudioNet,
    encode_detours,
    size_of,
)
from objectfolder.audio.audionet.geodesic_embedding import farthest_points, geodesic_embedding
from objectfolder.audio.audionet.least_squares import (
    Controls,
    Data,
    Equations,
    equations,
    predict,
    relative_error,
    solve,
)
from objectfolder.audio.audionet.surface_kernel import KernelParameters, SurfaceKernel
from objectfolder.products.integer_coding import pack_integers, zigzag
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
# Training points over which the local error of a fit is the mean.
NEIGHBOURS = 8
# Control points for which kernels are compared.
COMPARED = 320
POINTS_COMPARED = 3000
# More control points than a quarter of the training points fit the points rather than the field between.
LEAST_POINTS_A_CONTROL = 4
GROUP = 16
CHECKED, JUDGED = (7, 15), 3  # of a group of training points
DETOUR_DIMENSIONS = 5
# Detours narrower than this share of the object's size part nothing.
NARROW_DETOUR = 0.01
# A detour coordinate much narrower than the widest is not worth its bytes.
SHARE_OF_WIDEST = 0.15
# In the spread of control points a turn of the normal counts as this share of the object's size.
NORMAL_REACH = 0.03
# Rounding up from 0.6 rather than 0.5 saves more bytes than a finer step would cost for the same error.
ROUND_UP_FROM = 0.6
# Share of the error at the goal that the rounding may make up.
ROUNDING_SHARE = 0.5
# Where the goal is not met, the rounding may be this share of the error, which makes it 3 % larger.
ROUNDING_SHARE_SHORT = 0.25


def fit_audionet(
    surface: Surface,
    modes: Product,
    *,
    goal_db: float = -45.0,
    most_bytes: int = 320_000,
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

    Returns
    -------
    AudioNet
        Its metadata state ``validation_error_db``, measured at training points that chose nothing, before
        the last fit, which has them too.

    Raises
    ------
    ValueError
        Bytes that do not hold even the frequencies.
    """
    training = ~modes["held_out"]
    shapes = modes["mode_shapes"][training].astype(np.float64)
    values = shapes.reshape(len(shapes), 3 * shapes.shape[2])
    own = {name: np.array(modes[name], dtype=np.float64) for name in MODE_TENSORS}
    room = most_bytes - sum(tensor.nbytes for tensor in own.values()) - 8
    if values.size:
        nearest = surface.closest_points(modes["points"][training])
        data = Data(nearest.face, nearest.barycentric, values)
        tensors, described = _fit_fields(surface, data, 10 ** (goal_db / 20), room)
    else:
        tensors, described = _nothing(), {"kernel": asdict(KernelParameters()), "detour_dimensions": 0}
    metadata = {
        "audible": len(modes["eigenvalues"]) > 0,
        "absent": modes.attributes.get("absent"),
        "modes": len(modes["eigenvalues"]),
        "control_points": len(tensors["control_faces"]),
        "training_points": len(values),
        "validation_error_db": None,
        "frequency_limit_hz": modes.attributes["stated_frequency_limit_hz"],
        "amplitude": "impulse N s . gains -> velocity of each mode, m/s over kg^1/2",
        **described,
    }
    stored = {f"audio.{name}": tensor for name, tensor in {**tensors, **own}.items()}
    radiation = radiation_of(modes)
    if radiation is not None:
        transfer = AirTransfer.of(radiation)
        stored.update(transfer.tensors())
        metadata["transfer"] = transfer.metadata()
    return AudioNet(stored, metadata, surface)


def _fit_fields(
    surface: Surface, data: Data, goal: float, room: int
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Tensors of the fields without prefix, and kernel, dimensions and error as metadata."""
    place = np.arange(len(data.values)) % GROUP
    checks = np.isin(place, CHECKED)
    tested, judged = data.part(checks), data.part(place == JUDGED)
    fitted = data.part(~checks & (place != JUDGED))
    most = max(1, len(data.values) // LEAST_POINTS_A_CONTROL)
    detours, kernel = _choose_kernel(surface, fitted, tested, min(COMPARED, most))
    stream = encode_detours(detours, size_of(surface))
    room -= len(stream)
    controls, system, fit, error = _add_controls(kernel, fitted, tested, most, goal, room)
    more = equations(kernel, controls, tested.joined(judged))
    coefficients = solve(system[0] + more[0], system[1] + more[1], system[2])
    allowed = max(np.sqrt(max(goal**2 - error**2, 0.0)), ROUNDING_SHARE_SHORT * error)
    room -= 6 * len(controls[0])
    quantised, step = _rounded_on_surface(kernel, controls, coefficients, tested, allowed, room)
    described: dict[str, Any] = {
        "kernel": asdict(kernel.parameters),
        "detour_dimensions": detours.shape[1],
    }
    if len(judged.values):
        change = quantised * step - coefficients
        reached = np.hypot(
            relative_error(kernel, controls, fit, judged),
            np.linalg.norm(predict(kernel, controls, change, judged)) / np.linalg.norm(judged.values),
        )
        described["validation_error_db"] = float(20 * np.log10(max(reached, 1e-12)))
    tensors: dict[str, np.ndarray] = {
        "control_faces": controls[0].astype(np.int32),
        "control_barycentric": controls[1],
        "detours": stream,
        "coefficients": pack_integers(zigzag(quantised)),
        "step": np.array([step]),
    }
    return tensors, described


def _add_controls(
    kernel: SurfaceKernel, fitted: Data, tested: Data, most: int, goal: float, room: int
) -> tuple[Controls, Equations, Floats, float]:
    """Control points until the goal is met at the points tested, with their equations, fit and error."""
    counts = sorted({min(count, most, len(fitted.values)) for count in CONTROL_POINTS})
    place = _places(kernel, fitted)
    every = farthest_points(place, min(SPREAD, counts[-1]))
    squared_misfit = np.ones(len(place))
    error = 0.0
    for count in counts:
        if count > len(every):
            every = _more_where_worst(place, every, squared_misfit, count)
        controls = _stored(fitted, every[:count])
        system = equations(kernel, controls, fitted)
        fit = solve(*system)
        if len(tested.values):
            error = relative_error(kernel, controls, fit, tested)
            if error <= goal * np.sqrt(1 - ROUNDING_SHARE):
                break
            if count >= MANY and _bytes_used(fit, ROUNDING_SHARE * error) > ROOM_USED * room:
                break
        if count >= len(every) and count < counts[-1]:
            misfit = predict(kernel, controls, fit, fitted) - fitted.values
            squared_misfit = np.sum(misfit**2, axis=1)
    return controls, system, fit, error


def _rounded_on_surface(
    kernel: SurfaceKernel, controls: Controls, coefficients: Floats, tested: Data, allowed: float, room: int
) -> tuple[Integers, float]:
    """Whole numbers and their step, for a relative error allowed at the points tested.

    Control points are not spread by area alone: what a coefficient's error is on the surface is tried.
    """
    quantised, step = _quantise(coefficients, allowed, room)
    if not len(tested.values):
        return quantised, step
    change = quantised * step - coefficients
    rounding = np.linalg.norm(predict(kernel, controls, change, tested)) / np.linalg.norm(tested.values)
    factor = max(float(rounding * np.linalg.norm(coefficients) / np.linalg.norm(change)), 0.1)
    return _quantise(coefficients, allowed / factor, room)


def _nothing() -> dict[str, np.ndarray]:
    return {
        "control_faces": np.zeros(0, dtype=np.int32),
        "control_barycentric": np.zeros((0, 2), dtype=np.uint8),
        "detours": encode_detours(np.zeros((0, 0)), 1.0),
        "coefficients": pack_integers(np.zeros(0, dtype=np.int64)),
        "step": np.ones(1),
    }


def _choose_kernel(surface: Surface, fitted: Data, tested: Data, count: int) -> tuple[Floats, SurfaceKernel]:
    """The kernel that tests best with few control points, with detours or without."""
    size = size_of(surface)
    coordinates, spread = geodesic_embedding(surface, DETOUR_DIMENSIONS)
    wide = spread > max(NARROW_DETOUR * size, SHARE_OF_WIDEST * spread[0])
    coordinates = np.rint(coordinates[:, wide] / (DETOUR_STEP * size)) * (DETOUR_STEP * size)
    plain = np.zeros((len(surface.vertices), 0))
    best = plain, SurfaceKernel(surface, plain, KernelParameters())
    if not wide.any() or not len(tested.values):
        return best
    with_detours = SurfaceKernel(surface, coordinates, replace(KernelParameters(), detour_weight=0.5))
    few = fitted.part(slice(None, None, max(1, len(fitted.values) // POINTS_COMPARED)))
    errors = []
    for kernel in (best[1], with_detours):
        controls = _stored(fitted, farthest_points(_places(kernel, fitted), min(count, len(fitted.values))))
        coefficients = solve(*equations(kernel, controls, few))
        errors.append(relative_error(kernel, controls, coefficients, tested))
    # Detours cost bytes: they must be worth it.
    return (coordinates, with_detours) if errors[1] < 0.8 * errors[0] else best


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


def _bytes_used(coefficients: Floats, allowed: float) -> int:
    """Bytes of coefficients (controls, columns) rounded to the relative error allowed."""
    return len(pack_integers(zigzag(_rounded(coefficients, _step(coefficients, allowed)))))


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
    low = high = step = _step(coefficients, allowed)
    while len(pack_integers(zigzag(_rounded(coefficients, high)))) > room:
        if high > 4 * np.abs(coefficients).max():
            raise ValueError(f"{room} bytes are too few for {coefficients.shape[1]} columns of coefficients")
        low, high = high, 2 * high
    for _ in range(5 if high > step else 0):
        middle = np.sqrt(low * high)
        if len(pack_integers(zigzag(_rounded(coefficients, middle)))) <= room:
            high = middle
        else:
            low = middle
    return _rounded(coefficients, high), float(high)


def _rounded(coefficients: Floats, step: float) -> Integers:
    whole = np.floor(np.abs(coefficients) / step + (1 - ROUND_UP_FROM))
    return (np.sign(coefficients) * whole).astype(np.int64)
