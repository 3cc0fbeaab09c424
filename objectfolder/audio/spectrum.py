"""The audible spectrum of a free solid: eigenpairs, certificate, and the error of the discretisation."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.eigen import count_below, lowest_elastic, rigid_motions
from objectfolder.audio.elasticity import assemble
from objectfolder.audio.lagrange import LagrangeSpace
from objectfolder.audio.tetrahedra import Solid
from objectfolder.errors import SimulationError

Floats = NDArray[np.float64]
ESTIMATED_MODES = 10
# A cut between two modes is looked for among the last so many of the modes wanted.
CUT_CHOICES = 16


@dataclass(frozen=True)
class Spectrum:
    """Elastic modes below a limit, dimensionless: lengths in L, eigenvalues eta^2 = (omega L / c_s)^2.

    Attributes
    ----------
    space : finite-element space, vertices in units of L
    eta_squared : (k,) float64
    vectors : (node_count, 3, k) float64, of unit mass for density 1
    residuals : (k,) float64, |K u - eta^2 M u| / |eta^2 M u|
    limit : eta^2 below which every mode is here
    certificate : JSON-able
    rigid_eta_squared : largest |u^T K u| of the rigid motions, zero but for rounding
    """

    space: LagrangeSpace
    eta_squared: Floats
    vectors: Floats
    residuals: Floats
    limit: float
    certificate: dict[str, Any]
    rigid_eta_squared: float


def space_on(solid: Solid, order: int, length: float) -> LagrangeSpace:
    """Finite-element space of an order on a solid, lengths in units of `length` metres."""
    return LagrangeSpace.on(solid.vertices / length, solid.tetrahedra, order)


def solve_spectrum(
    space: LagrangeSpace,
    component: NDArray[np.int64],
    poisson_ratio: float,
    *,
    below: float,
    max_modes: int,
    seed: int,
    certify: bool = True,
    cut: bool = True,
) -> Spectrum:
    """Elastic modes with eta^2 < `below`, or the lowest of them up to `max_modes`, cut in a gap.

    Parameters
    ----------
    component
        (v,) body of each vertex.
    certify
        Count the modes by inertia, and refuse an incomplete set.
    cut
        Where more than `max_modes` modes are wanted, end in the widest gap among the last few of them,
        rather than at exactly so many.

    Raises
    ------
    SimulationError
        When the inertia count and the modes found differ after a second search.
    """
    stiffness, mass = assemble(space, poisson_ratio)
    of_node = np.empty(space.node_count, dtype=np.int64)
    of_node[space.nodes] = component[space.tetrahedra[:, :1]]
    rigid = rigid_motions(space.node_positions(), of_node, mass)
    stiff_rigid = stiffness @ rigid
    for attempt, tolerance in enumerate((1e-7, 1e-11)):
        pairs = lowest_elastic(
            stiffness,
            mass,
            rigid,
            below=below,
            at_most=max_modes,
            shift=-min(0.05, below / 4),
            tolerance=tolerance,
            seed=seed + attempt,
        )
        kept, limit = _cut(pairs.values, below, max_modes, CUT_CHOICES if cut else 1)
        counted = count_below(stiffness, mass, limit) if certify else kept + rigid.shape[1]
        if counted == kept + rigid.shape[1]:
            break
    else:
        raise SimulationError(
            "modes",
            f"inertia counts {counted - rigid.shape[1]} elastic modes, {kept} were found",
            "Change the frequency limit or the seed.",
        )
    values, vectors = pairs.values[:kept], pairs.vectors[:, :kept]
    inertia = (mass @ vectors) * values
    residuals = np.linalg.norm(stiffness @ vectors - inertia, axis=0) / np.linalg.norm(inertia, axis=0)
    largest = np.abs(vectors).argmax(axis=0)
    vectors = vectors * np.sign(vectors[largest, np.arange(kept)])
    certificate = {
        "method": "negative pivots of K - limit M (Sylvester)" if certify else "none",
        "counted": int(counted),
        "rigid": int(rigid.shape[1]),
        "elastic_found": int(kept),
        "holds": bool(certify),
    }
    return Spectrum(
        space,
        values,
        vectors.reshape(space.node_count, 3, kept),
        residuals,
        limit,
        certificate,
        float(np.abs(np.sum(rigid * stiff_rigid, axis=0)).max()),
    )


def _cut(values: Floats, below: float, max_modes: int, tried: int) -> tuple[int, float]:
    """How many of the modes to keep, and a limit that separates them from the next."""
    inside = int(np.count_nonzero(values < below))
    max_modes = min(max_modes, len(values) - 1) if np.isinf(below) else max_modes
    if inside <= max_modes:
        return inside, below
    choices = np.arange(max(1, max_modes - tried + 1), max_modes + 1)
    ratio = values[choices] / values[choices - 1]
    kept = int(choices[int(ratio.argmax())])
    return kept, float(np.sqrt(values[kept - 1] * values[kept]))


def first_frequencies(solid: Solid, length: float, order: int, poisson_ratio: float) -> Floats:
    """Dimensionless frequencies eta of the lowest elastic modes, (at most `ESTIMATED_MODES`,) float64."""
    spectrum = solve_spectrum(
        space_on(solid, order, length),
        solid.component,
        poisson_ratio,
        below=np.inf,
        max_modes=ESTIMATED_MODES,
        seed=0,
        certify=False,
        cut=False,
    )
    return np.sqrt(spectrum.eta_squared)


def relative_errors(frequencies: list[Floats]) -> Floats:
    """Estimated relative discretisation errors of the last of frequencies (k,) of orders 1, 2, .. p.

    Frequencies of rising order on the same elements converge geometrically in it, so Aitken's extrapolation
    f* = f_p - d_p r / (1 - r), d_p = f_(p-1) - f_p, r = d_p / d_(p-1), tells how far f_p is from its limit;
    r is taken over all the modes together, as single modes may change places between orders.
    With two orders the ratio r is unknown; 1/15 is taken, as seen on walls one element thick (thick bodies
    have 1/40). The error of the geometry is not in it.
    """
    count = min(map(len, frequencies))
    steps = [f[:count] for f in frequencies]
    gained = np.maximum(steps[-2] - steps[-1], 0)
    ratio = 1 / 15
    if len(steps) > 2:
        before = np.sum(np.maximum(steps[-3] - steps[-2], 0))
        ratio = float(np.clip(gained.sum() / max(before, 1e-300), 0, 0.9))
    return gained * ratio / (1 - ratio) / steps[-1]


def to_cents(relative: Floats) -> float:
    """Largest of relative frequency errors, in cents."""
    return float(1200 * np.log2(1 + np.max(relative)))


def unknowns(solid: Solid, order: int) -> int:
    """Unknowns of an order on a solid."""
    return 3 * LagrangeSpace.on(solid.vertices, solid.tetrahedra, order).node_count


def boundary_barycentric(
    faces: NDArray[np.int64], opposite: NDArray[np.int64], local: NDArray[np.int64], weights: Floats
) -> Floats:
    """Barycentric coordinates in the element, (n, 4), of points given by `weights` (n, 3) on its faces.

    Parameters
    ----------
    faces
        (n,) rows of `local`.
    opposite
        (f,) local corner opposite each boundary triangle.
    local
        (4, 3) local corners of each face of a tetrahedron.
    """
    barycentric = np.zeros((len(weights), 4))
    np.put_along_axis(barycentric, local[opposite[faces]], weights, axis=1)
    return barycentric
