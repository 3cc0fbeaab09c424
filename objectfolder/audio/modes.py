"""The modal sound of an object: from a surface and a material to frequencies, dampings and mode shapes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from objectfolder.audio.lagrange import LagrangeSpace, basis
from objectfolder.audio.materials import Material
from objectfolder.audio.spectrum import (
    ESTIMATED_MODES,
    Spectrum,
    boundary_barycentric,
    first_frequencies,
    relative_errors,
    solve_spectrum,
    space_on,
    to_cents,
    unknowns,
)
from objectfolder.audio.tetrahedra import LOCAL_FACES, Filling, Solid, fill
from objectfolder.geometry.surface import Surface
from objectfolder.store import Array, Product

Floats = NDArray[np.float64]


def simulate_modes(
    surface: Surface,
    material: Material,
    *,
    max_frequency_hz: float = 20000.0,
    max_modes: int = 256,
    training_points: int,
    held_out_points: int,
    seed: int,
    order: int = 3,
    max_unknowns: int = 120_000,
    error_goal_cents: float = 5.0,
    filling: Filling | None = None,
    name: str = "surface",
) -> Product:
    """Fill a surface and solve every elastic mode below a frequency.

    Parameters
    ----------
    surface
        Metres, faces outward; need not be closed.
    max_frequency_hz
        Upper end of the band. Where more than `max_modes` modes lie in it, the band ends earlier, in a gap
        between two modes: attribute `stated_frequency_limit_hz`.
    training_points, held_out_points
        Points drawn uniformly by area at which the mode shapes are given.
    order
        Highest order of the elements, 1 to 3. Order 3 gives way to 2 where it has more than `max_unknowns`
        unknowns, where all audible modes are estimated within `error_goal_cents` by order 2, or where the
        first mode of order 2 lies above the limit by more than four times its estimated error.
    filling
        Resolution of the tetrahedra.

    Returns
    -------
    Product
        See `modes_of_solid`.

    Raises
    ------
    SimulationError
        No solid came of the surface, or the modes found fail the count.
    """
    solid = fill(surface, filling, name=name)
    return modes_of_solid(
        surface,
        solid,
        material,
        max_frequency_hz=max_frequency_hz,
        max_modes=max_modes,
        training_points=training_points,
        held_out_points=held_out_points,
        seed=seed,
        order=order,
        max_unknowns=max_unknowns,
        error_goal_cents=error_goal_cents,
    )


def modes_of_solid(
    surface: Surface,
    solid: Solid,
    material: Material,
    *,
    max_frequency_hz: float,
    max_modes: int,
    training_points: int,
    held_out_points: int,
    seed: int,
    order: int = 3,
    max_unknowns: int = 120_000,
    error_goal_cents: float = 5.0,
) -> Product:
    """Elastic modes of a solid, given at points of a surface; parameters as for `simulate_modes`.

    Returns
    -------
    Product
        Arrays: `frequencies_hz` (mode,) of the damped mode sqrt(lambda - c^2) / 2 pi; `eigenvalues` (mode,)
        lambda = omega^2, rad^2/s^2; `dampings_per_s` (mode,) c = (alpha + beta lambda) / 2; `residuals`
        (mode,);
        `radiation_weights` (mode,), rms over the surface of the normal component of the mode, kg^-1/2;
        `points` (point, 3) metres; `mode_shapes` (point, 3, mode) float32, u^T M u = 1, kg^-1/2;
        `held_out` (point,) bool. Without an audible mode all of (mode,) have length 0 and `audible` is false.
        A mode with c^2 >= lambda does not ring and is left out, counted in `overdamped_modes`.
    """
    length = float(np.ptp(solid.vertices, axis=0).max())
    radians = material.shear_speed_m_s / length  # omega = eta c_s / L
    below = (2 * np.pi * max_frequency_hz / radians) ** 2
    lower = [first_frequencies(solid, length, p, material.poisson_ratio) for p in range(1, min(order, 3))]
    if order == 3 and (
        unknowns(solid, 3) > max_unknowns or _second_order_is_enough(lower, np.sqrt(below), error_goal_cents)
    ):
        order = 2
    spectrum = solve_spectrum(
        space_on(solid, order, length),
        solid.component,
        material.poisson_ratio,
        below=below,
        max_modes=max_modes,
        seed=seed,
    )
    eigenvalues = spectrum.eta_squared * radians**2
    dampings = (material.rayleigh_alpha_per_s + material.rayleigh_beta_s * eigenvalues) / 2
    rings = eigenvalues > dampings**2
    mass_kg = material.density_kg_m3 * solid.volume_m3
    scale = 1 / np.sqrt(material.density_kg_m3 * length**3)  # of mass 1 kg rather than rho L^3

    train = surface.sample(training_points, seed)
    test = surface.sample(held_out_points, seed + 1_000_003)
    points = np.concatenate([train.points, test.points])
    boundary = Boundary(solid)
    shapes, distance = boundary.evaluate(spectrum, points, solid.report.get("epsilon_m", 0.0))
    weights = boundary.normal_rms(spectrum) * scale
    found = np.sqrt(spectrum.eta_squared[:ESTIMATED_MODES])
    ladder = [*lower[: order - 1], found]
    estimate = to_cents(relative_errors(ladder)) if len(found) and order > 1 else None

    limit_hz = float(np.sqrt(spectrum.limit) * radians / (2 * np.pi))
    frequencies = np.sqrt(eigenvalues[rings] - dampings[rings] ** 2) / (2 * np.pi)
    arrays = {
        "frequencies_hz": Array(frequencies, ("mode",), "Hz", "damped eigenfrequency"),
        "eigenvalues": Array(eigenvalues[rings], ("mode",), "rad2 s-2", "squared angular eigenfrequency"),
        "dampings_per_s": Array(dampings[rings], ("mode",), "s-1", "decay rate of the amplitude"),
        "residuals": Array(spectrum.residuals[rings], ("mode",), "1", "|K u - lambda M u| / |lambda M u|"),
        "radiation_weights": Array(
            weights[rings], ("mode",), "kg-1/2", "rms over the surface of the normal component"
        ),
        "points": Array(points, ("point", "axis"), "m", "points of the surface, object frame", False),
        "mode_shapes": Array(
            (shapes[:, :, rings] * scale).astype(np.float32),
            ("point", "axis", "mode"),
            "kg-1/2",
            "mass-normalised mode shape",
            False,
        ),
        "held_out": Array(
            np.arange(len(points)) >= training_points, ("point",), "1", "point is not for fitting"
        ),
    }
    attributes: dict[str, Any] = {
        "audible": bool(rings.any()),
        "stated_frequency_limit_hz": limit_hz,
        "max_frequency_hz": float(max_frequency_hz),
        "overdamped_modes": int(np.count_nonzero(~rings)),
        "count_certificate": {**spectrum.certificate, "limit_hz": limit_hz},
        "error_estimate_cents": estimate,
        "rigid_frequency_hz": float(np.sqrt(spectrum.rigid_eta_squared) * radians / (2 * np.pi)),
        "discretisation": {
            "order": order,
            "elements": len(solid.tetrahedra),
            "unknowns": 3 * spectrum.space.node_count,
            **solid.report,
        },
        "volume_m3": solid.volume_m3,
        "mass_kg": mass_kg,
        "effective_wall_thickness_m": 2 * solid.volume_m3 / boundary.surface.area,
        "transfer_distance_max_m": float(distance.max(initial=0.0)),
        "material": material.name,
    }
    return Product(arrays, attributes)


def _second_order_is_enough(lower: list[Floats], limit: float, error_goal_cents: float) -> bool:
    """Whether orders 1 and 2 show that no mode is audible, or all audible ones are within the goal."""
    errors = relative_errors(lower)
    silent = bool(lower[-1][0] * (1 - 4 * errors[0]) > limit)
    return silent or bool(lower[-1][-1] > limit and to_cents(errors) < error_goal_cents)


class Boundary:
    """The outside of a solid, where mode shapes are read."""

    def __init__(self, solid: Solid) -> None:
        faces, self.element, self.opposite = solid.boundary()
        self.surface = Surface(solid.vertices, faces)
        self._solid = solid

    def evaluate(self, spectrum: Spectrum, points: Floats, epsilon: float) -> tuple[Floats, Floats]:
        """Mode shapes at points, (n, 3, modes), and how far each was moved to where it was read, (n,) metres.

        A point is read at the nearest point of the boundary, or where it lies when it is inside by more than
        `epsilon` (a face of one part hidden in another).
        """
        nearest = self.surface.closest_points(points)
        element = self.element[nearest.face]
        barycentric = boundary_barycentric(nearest.face, self.opposite, LOCAL_FACES, nearest.barycentric)
        distance = nearest.distance.copy()
        deep = np.flatnonzero(distance > 2 * epsilon)
        if len(deep):
            holder, inside = _locate(self._solid, points[deep])
            found = holder >= 0
            element[deep[found]], barycentric[deep[found]] = holder[found], inside[found]
            distance[deep[found]] = 0.0
        return _values(spectrum.space, spectrum.vectors, element, barycentric), distance

    def normal_rms(self, spectrum: Spectrum) -> Floats:
        """Root mean square over the boundary of the normal component of each mode, (modes,)."""
        points, quadrature = np.polynomial.legendre.leggauss(4)
        a, b = np.meshgrid((points + 1) / 2, (points + 1) / 2, indexing="ij")
        weight = np.outer(quadrature, quadrature).ravel() / 4 * 2 * (1 - a.ravel())
        rule = np.stack([a.ravel(), (b * (1 - a)).ravel(), ((1 - b) * (1 - a)).ravel()], axis=1)
        total = np.zeros(spectrum.vectors.shape[2])
        for start in range(0, len(self.element), 256):
            faces = np.repeat(np.arange(start, min(start + 256, len(self.element))), len(rule))
            tiled = np.tile(rule, (len(faces) // len(rule), 1))
            barycentric = boundary_barycentric(faces, self.opposite, LOCAL_FACES, tiled)
            values = _values(spectrum.space, spectrum.vectors, self.element[faces], barycentric)
            normal = np.einsum("nk,nkm->nm", self.surface.face_normals[faces], values)
            area = self.surface.face_areas[faces] * np.tile(weight, len(faces) // len(rule))
            total += area @ normal**2
        return np.sqrt(total / self.surface.area)


def _values(space: LagrangeSpace, vectors: Floats, element: NDArray[np.int64], barycentric: Floats) -> Floats:
    """Mode shapes (n, 3, modes) at barycentric coordinates (n, 4) in elements (n,)."""
    value, _ = basis(barycentric, space.order)
    result = np.zeros((len(element), *vectors.shape[1:]))
    for local in range(value.shape[1]):
        result += value[:, local, None, None] * vectors[space.nodes[element, local]]
    return result


def _locate(solid: Solid, points: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Element that holds each point, -1 for none, and the barycentric coordinates in it."""
    corner = solid.vertices[solid.tetrahedra]
    near = min(64, len(corner))
    _, candidates = cKDTree(corner.mean(axis=1)).query(points, near)
    candidates = np.asarray(candidates).reshape(len(points), near)
    inverse = np.linalg.inv(corner[:, 1:] - corner[:, :1])
    offset = points[:, None] - corner[candidates, 0]
    rest = np.einsum("nca,ncab->ncb", offset, inverse[candidates])
    barycentric = np.concatenate([1 - rest.sum(axis=2, keepdims=True), rest], axis=2)
    least = barycentric.min(axis=2)
    best = least.argmax(axis=1)
    rows = np.arange(len(points))
    return np.where(least[rows, best] >= -1e-9, candidates[rows, best], -1), barycentric[rows, best]
