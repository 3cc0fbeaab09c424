"""Fitting AudioNet: where control points go, how many there are, and what corrects them.

Of sixteen training points two choose among fits and one judges the choice; the last fit is to all of them.
"""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from objectfolder.audio.air.transfer import AirTransfer
from objectfolder.audio.audionet.audionet import (
    BARYCENTRIC_STEPS,
    DETOUR_STEP,
    MODE_TENSORS,
    RADIATION,
    AudioNet,
    encode_detours,
    size_of,
)
from objectfolder.audio.audionet.surface_kernel import KernelParameters, SurfaceKernel
from objectfolder.making.air.radiation_product import radiation_of
from objectfolder.making.audionet.corrections import Fields
from objectfolder.making.audionet.geodesic_embedding import farthest_points, geodesic_embedding
from objectfolder.making.audionet.least_squares import Basis, Data, Equations, equations, sizes, solve
from objectfolder.making.audionet.rounding import bytes_rounded, round_fields
from objectfolder.products.integer_coding import pack_integers
from objectfolder.products.matrix_coding import pack_matrix
from objectfolder.products.store import Product
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

CONTROL_POINTS = (60, 120, 240, 400, 640, 1000, 1500, 2000, 3000)
# With so many, more bring less than they cost where they fill this share of the bytes, or where corrections
# bring the error down to this share.
MANY_POINTS, ROOM_USED, CORRECTION_RATIO = 2000, 0.7, 0.5
# So many control points are spread evenly; more go where the fit to these is worst.
SPREAD = 640
# Training points over which the local error of a fit is the mean.
ERROR_NEIGHBOURS = 8
# Control points for which kernels are compared.
KERNEL_CONTROL_POINTS = 320
POINTS_COMPARED = 3000
# More control points than a quarter of the training points fit the points rather than the field between.
LEAST_POINTS_A_CONTROL = 4
GROUP_MODES = 16
CHECKED, JUDGED = (7, 15), 3  # of a group of training points
DETOUR_DIMENSIONS = 5
# Detours narrower than this share of the object's size part nothing.
NARROW_DETOUR = 0.01
# A detour coordinate much narrower than the widest is not worth its bytes.
SHARE_OF_WIDEST = 0.15
# In the spread of control points a turn of the normal counts as this share of the object's size.
NORMAL_REACH = 0.03
# Share of the error at the goal that the rounding may make up.
ROUNDING_SHARE = 0.45
# The error that 5 % of the points may have, over that of the goal.
TAIL = 10 ** (9 / 20)
# Weights of the regularisation of corrections that are compared.
WEIGHTS = (0.01, 0.03, 0.1, 0.3)
# Of more vertices the training points see too little.
MOST_CORRECTED = 20_000


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
    names = (*MODE_TENSORS, RADIATION) if RADIATION in modes.arrays else MODE_TENSORS
    own = {name: np.array(modes[name], dtype=np.float64) for name in names}
    room = most_bytes - sum(tensor.nbytes for tensor in own.values()) - 8
    if values.size:
        nearest = surface.closest_points(modes["points"][training])
        data = Data.weighted(nearest.face, nearest.barycentric, values)
        tensors, described = _fit_fields(surface, data, 10 ** (goal_db / 20), room)
    else:
        tensors, described = (
            _nothing(),
            {"kernel": asdict(KernelParameters()), "detour_dimensions": 0, "corrections": 0},
        )
    metadata = {
        "audible": len(modes["eigenvalues"]) > 0,
        "absent": modes.attributes.get("absent"),
        "modes": len(modes["eigenvalues"]),
        "control_points": len(tensors["control_faces"]),
        "training_points": len(values),
        "validation_error_db": None,
        "frequency_limit_hz": modes.attributes["stated_frequency_limit_hz"],
        "damping": modes.attributes.get("damping"),
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
    place = np.arange(len(data.values)) % GROUP_MODES
    checks = np.isin(place, CHECKED)
    tested, judged = data.part(checks), data.part(place == JUDGED)
    fitted = data.part(~checks & (place != JUDGED))
    most = max(1, len(data.values) // LEAST_POINTS_A_CONTROL)
    detours, kernel = _choose_kernel(surface, fitted, tested, min(KERNEL_CONTROL_POINTS, most))
    stream = encode_detours(detours, size_of(surface))
    first, weight, system = _fit_smooth(kernel, fitted, tested, most, goal, room - len(stream))
    more = equations(first.basis, tested.joined(judged))
    last = Fields(first.basis, solve(system[0] + more[0], system[1] + more[1], system[2]))
    if weight is not None:
        (last,) = last.corrected(data, (weight,))
    controls = first.basis.controls
    allowed = _allowed_rounding(first, tested, goal)
    rounded = round_fields(last, tested, allowed, room - len(stream) - 6 * len(controls[0]))
    described: dict[str, Any] = {
        "kernel": asdict(kernel.parameters),
        "detour_dimensions": detours.shape[1],
        "corrections": len(rounded.vertices),
    }
    if len(judged.values):
        fit, rounding = first.at(judged) - judged.values, rounded.change(last).at(judged)
        reached = np.sqrt(np.sum(fit**2 + rounding**2) / np.sum(judged.values**2))
        described["validation_error_db"] = float(20 * np.log10(max(reached, 1e-12)))
    tensors: dict[str, np.ndarray] = {
        "control_faces": controls[0].astype(np.int32),
        "control_barycentric": controls[1],
        "detours": stream,
        **rounded.tensors(),
    }
    return tensors, described


def _fit_smooth(
    kernel: SurfaceKernel, fitted: Data, tested: Data, most: int, goal: float, room: int
) -> tuple[Fields, float | None, Equations]:
    """Fields of control points until the goal is met at the points tested, and their equations.

    Where it is not, they have corrections, whose weight comes second.
    """
    counts = sorted({min(count, most, len(fitted.values)) for count in CONTROL_POINTS})
    counts = counts if len(tested.values) else counts[-1:]
    place = _places(kernel, fitted)
    every = farthest_points(place, min(SPREAD, counts[-1]))
    squared_misfit = np.ones(len(place))
    for count in counts:
        if count > len(every):
            every = _more_where_worst(place, every, squared_misfit, count)
        basis = Basis(kernel, _stored(fitted, every[:count]))
        system = equations(basis, fitted)
        fields = Fields(basis, solve(*system))
        if not len(tested.values) or _reached(fields, tested, goal):
            return fields, None, system
        if count >= MANY_POINTS or count == counts[-1]:
            corrected, weight = _corrected(fields, fitted, tested)
            error, corrected_error = (_errors(candidate, tested)[0] for candidate in (fields, corrected))
            if (
                corrected_error < CORRECTION_RATIO * error
                or bytes_rounded(fields, ROUNDING_SHARE * error) > ROOM_USED * room
            ):
                break
        if count >= len(every) and count < counts[-1]:
            misfit = fitted.weights[:, None] * (fields.at(fitted) - fitted.values)
            squared_misfit = np.sum(misfit**2, axis=1)
    return corrected, weight, system


def _corrected(fields: Fields, fitted: Data, tested: Data) -> tuple[Fields, float | None]:
    """Fields with the corrections that test best, and their weight."""
    tried: list[tuple[Fields, float | None]] = [(fields, None)]
    if len(fields.basis.kernel.surface.vertices) <= MOST_CORRECTED:
        tried += zip(fields.corrected(fitted, WEIGHTS), WEIGHTS, strict=True)
    return min(tried, key=lambda candidate: _errors(candidate[0], tested)[0])


def _errors(fields: Fields, tested: Data) -> tuple[float, float]:
    """Relative error, and that which 5 % of the points exceed."""
    error = np.sum((fields.at(tested) - tested.values) ** 2, axis=1)
    by_point = float(np.quantile(error / sizes(tested.values) ** 2, 0.95))
    return float(np.sqrt(error.sum() / np.sum(tested.values**2))), float(np.sqrt(by_point))


def _reached(fields: Fields, tested: Data, goal: float) -> bool:
    """Whether an error leaves room for rounding."""
    error, tail = _errors(fields, tested)
    return max(error, tail / TAIL) <= goal * np.sqrt(1 - ROUNDING_SHARE)


def _allowed_rounding(fields: Fields, tested: Data, goal: float) -> float:
    """Relative error that the rounding may add."""
    if not len(tested.values):
        return goal
    error, _ = _errors(fields, tested)
    quiet = float(np.quantile(sizes(tested.values), 0.05) * np.sqrt(len(tested.values)))
    quiet /= float(np.linalg.norm(tested.values))
    for_quiet = TAIL * goal * quiet * np.sqrt(ROUNDING_SHARE)
    return float(min(np.sqrt(max(goal**2 - error**2, ROUNDING_SHARE * goal**2)), for_quiet))


def _nothing() -> dict[str, np.ndarray]:
    return {
        "control_faces": np.zeros(0, dtype=np.int32),
        "control_barycentric": np.zeros((0, 2), dtype=np.uint8),
        "detours": encode_detours(np.zeros((0, 0)), 1.0),
        "coefficients": pack_matrix(np.zeros((0, 0), dtype=np.int64)),
        "corrected": pack_integers(np.zeros(0, dtype=np.int64)),
        "step": np.ones(2),
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
        basis = Basis(kernel, controls)
        errors.append(_errors(Fields(basis, solve(*equations(basis, few))), tested)[0])
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
    near = cKDTree(place).query(place, min(ERROR_NEIGHBOURS, len(place)))[1].reshape(len(place), -1)
    weight = np.sqrt(squared_misfit[near].mean(axis=1))
    return np.concatenate([chosen, farthest_points(place, count - len(chosen), weight, place[chosen])])


def _stored(data: Data, chosen: Integers) -> tuple[Integers, NDArray[np.uint8]]:
    """Faces (count,) and stored barycentric coordinates (count, 2) of some of the points."""
    two = np.floor(data.barycentric[chosen, :2] * BARYCENTRIC_STEPS).astype(np.uint8)
    return data.face[chosen], two
