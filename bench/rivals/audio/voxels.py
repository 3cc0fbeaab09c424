"""The papers' discretisation of sound: linear finite elements on a grid of cubes.

Every full cube is a trilinear hexahedron of eight vertices, integrated exactly. The published grid has 32
cubes along the longest side. Cubes that share only an edge or a vertex would be hinged there; they are
parted, so that each body joined through faces has six rigid motions. The papers say nothing of it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse

from bench.record import Stopwatch
from bench.rivals.audio.voxel_grid import VoxelGrid, voxelise
from objectfolder.audio.damping import RAYLEIGH, damping_of
from objectfolder.audio.materials import Material
from objectfolder.audio.modes.eigen import DENSE, Pencil, count_below, lowest_elastic, rigid_motions
from objectfolder.errors import SimulationError
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
# Eigenvalues nearer to one another than this share are one: a limit does not part them.
GAP = 1e-6


@dataclass(frozen=True)
class VoxelModes:
    """Elastic modes of a body of cubes, ascending.

    Attributes
    ----------
    frequencies_hz : (modes,) float64 damped, sqrt(lambda - c^2) / 2 pi; 0 where a mode does not ring
    eigenvalues : (modes,) float64 undamped lambda = omega^2, rad^2/s^2
    dampings_per_s : (modes,) float64 c = (alpha + beta lambda) / 2
    vectors : (n, 3, modes) float64, u^T M u = 1, kg^-1/2
    nodes : (n, 3) float64 vertices of the cubes, metres
    components : bodies joined through faces
    mass_kg : of the cubes
    mass_ratio : volume of the cubes over that within the surface; None where the surface encloses none
    unknowns : 3 n
    cells : full cubes
    limit_hz : undamped frequency below which every mode is here: counted by inertia, or all were computed
    cpu_s : CPU seconds of the steps ``voxelise``, ``assemble``, ``solve`` and ``count``
    """

    frequencies_hz: Floats
    eigenvalues: Floats
    dampings_per_s: Floats
    vectors: Floats
    nodes: Floats
    components: int
    mass_kg: float
    mass_ratio: float | None
    unknowns: int
    cells: int
    limit_hz: float
    cpu_s: dict[str, float]


def voxel_modes(
    surface: Surface,
    material: Material,
    *,
    resolution: int = 32,
    rule: str = "touch",
    max_frequency_hz: float = 20000.0,
    max_modes: int = 256,
    seed: int = 0,
) -> VoxelModes:
    """Elastic modes below a frequency of the cubes that stand for a surface.

    Parameters
    ----------
    surface
        Metres, faces outward.
    resolution, rule
        See `voxelise`.
    max_modes
        Where more modes lie below the limit, the lowest are kept and the limit is put in the last gap.
    seed
        Of the solver's start.

    Raises
    ------
    InputError
        From `voxelise`.
    SimulationError
        When the inertia count and the modes found differ after a second search.
    """
    watch = Stopwatch()
    with watch.step("voxelise"):
        grid = voxelise(surface, resolution, rule)
        hexahedra, nodes, body = _mesh(grid)
    # Lengths in cells and the mass of one cell as 1: omega^2 = eta^2 (c_s / edge)^2.
    radians = material.shear_speed_m_s / grid.edge_m
    below = (2 * np.pi * max_frequency_hz / radians) ** 2
    bodies, limit = _solve_bodies(
        hexahedra, nodes, body, material.poisson_ratio, below, max_modes, seed, watch
    )
    with watch.step("solve"):
        values, vectors, limit = _together(bodies, len(nodes), limit, max_modes)
    eigenvalues = values * radians**2
    dampings = damping_of(material, RAYLEIGH).decay_rates(eigenvalues)
    volume = len(hexahedra) * grid.edge_m**3
    enclosed = _enclosed_volume(surface)
    return VoxelModes(
        frequencies_hz=np.sqrt(np.maximum(eigenvalues - dampings**2, 0)) / (2 * np.pi),
        eigenvalues=eigenvalues,
        dampings_per_s=dampings,
        vectors=vectors / np.sqrt(material.density_kg_m3 * grid.edge_m**3),
        nodes=grid.origin_m + nodes * grid.edge_m,
        components=len(bodies),
        mass_kg=material.density_kg_m3 * volume,
        mass_ratio=volume / enclosed if enclosed > 0 else None,
        unknowns=3 * len(nodes),
        cells=len(hexahedra),
        limit_hz=float(np.sqrt(limit)) * radians / (2 * np.pi),
        cpu_s=watch.cpu_s,
    )


@dataclass(frozen=True)
class _Body:
    """Eigenvalues (k,) of one body, its vertices (n,) and its vectors (3 n, k)."""

    values: Floats
    members: Integers
    vectors: Floats


def _solve_bodies(
    hexahedra: Integers,
    nodes: Floats,
    body: Integers,
    poisson_ratio: float,
    below: float,
    max_modes: int,
    seed: int,
    watch: Stopwatch,
) -> tuple[list[_Body], float]:
    """Elastic pairs of every body by itself, and the limit below which they are all."""
    blocks = hexahedron(poisson_ratio)
    found: list[_Body] = []
    limit = below
    order = np.argsort(body[hexahedra[:, 0]], kind="stable")
    ends = np.cumsum(np.bincount(body[hexahedra[:, 0]], minlength=int(body.max()) + 1))
    for chosen in np.split(order, ends[:-1]):
        members, local = np.unique(hexahedra[chosen], return_inverse=True)
        with watch.step("assemble"):
            stiffness, mass = assemble(local.reshape(-1, 8), len(members), *blocks)
        positions = nodes[members] - nodes[members].mean(axis=0)
        values, vectors, certain = _solve(stiffness, mass, positions, below, max_modes, seed, watch)
        found.append(_Body(values, members, vectors))
        limit = min(limit, certain)
    return found, limit


def _together(bodies: list[_Body], nodes: int, limit: float, max_modes: int) -> tuple[Floats, Floats, float]:
    """Eigenvalues (k,) of all bodies, ascending, vectors (nodes, 3, k), and their limit."""
    values = np.concatenate([body.values for body in bodies])
    owner = np.repeat(np.arange(len(bodies)), [len(body.values) for body in bodies])
    column = np.concatenate([np.arange(len(body.values)) for body in bodies])
    ranks = np.argsort(values, kind="stable")
    kept = int(np.count_nonzero(values[ranks] < limit))
    if kept > max_modes:
        kept = _gap(values[ranks], max_modes)
        limit = float(np.sqrt(values[ranks[kept - 1]] * values[ranks[kept]]))
    vectors = np.zeros((nodes, 3, kept))
    for rank, mode in enumerate(ranks[:kept]):
        body = bodies[owner[mode]]
        vectors[body.members, :, rank] = body.vectors[:, column[mode]].reshape(-1, 3)
    return values[ranks[:kept]], vectors, limit


def hexahedron(poisson_ratio: float) -> tuple[Floats, Floats]:
    """Stiffness (24, 24) and mass (8, 8) of the unit cube, shear modulus 1 and density 1.

    Weak form lambda' (div u)(div v) + 2 eps(u) : eps(v), lambda' = 2 nu / (1 - 2 nu); products of linear
    functions of three coordinates, integrated exactly by 2 x 2 x 2 Gauss points. Unknown 3 vertex + axis,
    vertices as in `CORNERS`.

    Raises
    ------
    ValueError
        For a Poisson ratio outside (-1, 0.5).
    """
    if not -1 < poisson_ratio < 0.5:
        raise ValueError(f"Poisson ratio {poisson_ratio} is outside (-1, 0.5)")
    lame = 2 * poisson_ratio / (1 - 2 * poisson_ratio)
    stiffness, mass = np.zeros((8, 3, 8, 3)), np.zeros((8, 8))
    for place in CORNERS:
        point = 0.5 + (place - 0.5) / np.sqrt(3)
        factors = np.where(CORNERS == 1, point, 1 - point)  # (vertex, axis)
        slopes = np.where(CORNERS == 1, 1.0, -1.0)
        value = factors.prod(axis=1)
        gradient = np.stack(
            [slopes[:, k] * np.delete(factors, k, axis=1).prod(axis=1) for k in range(3)], axis=1
        )
        cross = np.einsum("ai,bj->aibj", gradient, gradient)
        laplacian = gradient @ gradient.T
        stiffness += (
            lame * cross + np.swapaxes(cross, 1, 3) + np.einsum("ab,ij->aibj", laplacian, np.eye(3))
        ) / 8
        mass += np.outer(value, value) / 8
    return stiffness.reshape(24, 24), mass


def assemble(
    hexahedra: Integers, count: int, stiffness_block: Floats, mass_block: Floats
) -> tuple[sparse.bsr_matrix, sparse.csr_matrix]:
    """Stiffness (3 count, 3 count) and mass of one axis (count, count) of equal elements, (t, 8) vertices."""
    row, column = np.repeat(hexahedra, 8, axis=1).ravel(), np.tile(hexahedra, (1, 8)).ravel()
    key, position = np.unique(row * count + column, return_inverse=True)
    position = position.reshape(-1)
    indices, indptr = key % count, np.searchsorted(key, np.arange(count + 1) * count)
    symmetric = (stiffness_block + stiffness_block.T) / 2
    local = np.transpose(symmetric.reshape(8, 3, 8, 3), (0, 2, 1, 3)).reshape(64, 9)
    blocks = np.stack(
        [np.bincount(position, np.tile(part, len(hexahedra)), minlength=len(key)) for part in local.T], axis=1
    )
    whole = sparse.bsr_matrix((blocks.reshape(-1, 3, 3), indices, indptr), shape=(3 * count, 3 * count))
    nodal = np.bincount(position, np.tile(mass_block.ravel(), len(hexahedra)), minlength=len(key))
    mass = sparse.csr_matrix((nodal, indices, indptr), shape=(count, count))
    return whole, mass


def _mesh(grid: VoxelGrid) -> tuple[Integers, Floats, Integers]:
    """Hexahedra (t, 8), vertices (n, 3) in cells, and the body (n,) of each vertex."""
    label, _ = ndimage.label(grid.full)
    cells = np.argwhere(grid.full)
    body = label[grid.full].astype(np.int64) - 1
    place = cells[:, None] + CORNERS
    sides = np.array(grid.full.shape) + 1
    name = np.ravel_multi_index(tuple(np.moveaxis(place, -1, 0)), tuple(sides))
    unique, hexahedra = np.unique(body[:, None] * sides.prod() + name, return_inverse=True)
    vertices = np.stack(np.unravel_index(unique % sides.prod(), tuple(sides)), axis=1)
    return hexahedra.reshape(-1, 8), vertices.astype(np.float64), unique // sides.prod()


def _solve(
    stiffness: sparse.bsr_matrix,
    mass: sparse.csr_matrix,
    positions: Floats,
    below: float,
    max_modes: int,
    seed: int,
    watch: Stopwatch,
) -> tuple[Floats, Floats, float]:
    """Elastic pairs of one body, and the limit below which they are all.

    The limit is `below`, or lower in a gap where many more than `max_modes` lie below it.
    """
    one_body = np.zeros(len(positions), dtype=np.int64)
    pencil = Pencil(stiffness, mass, rigid_motions(positions, one_body, len(positions), mass))
    longest = float(np.ptp(positions, axis=0).max())
    counted = -1
    for attempt, tolerance in enumerate((1e-7, 1e-11)):
        # A few more than wanted, so that a cut can avoid a multiple eigenvalue.
        with watch.step("solve"):
            pairs = lowest_elastic(
                pencil,
                below=below,
                at_most=max_modes + 8,
                shift=-min(0.05 / longest**2, below / 4),
                tolerance=tolerance,
                seed=seed + attempt,
            )
        kept = int(np.count_nonzero(pairs.values < below))
        limit = below
        if kept > max_modes + 1:
            kept = _gap(pairs.values, min(kept, len(pairs.values) - 1))
            limit = float(np.sqrt(pairs.values[kept - 1] * pairs.values[kept]))
        if pencil.size > DENSE:  # else all eigenvalues were computed
            with watch.step("count"):
                counted = count_below(pencil, limit)
        if pencil.size <= DENSE or counted == kept:
            return pairs.values[:kept], pairs.vectors[:, :kept], limit
    raise SimulationError(
        "voxel modes",
        f"inertia counts {counted} elastic modes, {kept} were found",
        "Change the frequency limit or the seed.",
    )


def _gap(values: Floats, at_most: int) -> int:
    """Largest number of leading values, up to `at_most`, that parts no multiple eigenvalue."""
    for kept in range(at_most, 0, -1):
        if values[kept] > values[kept - 1] * (1 + GAP):
            return kept
    raise SimulationError("voxel modes", f"more than {at_most} equal eigenvalues", "Ask for more modes.")


def _enclosed_volume(surface: Surface) -> float:
    """Signed volume within the surface, exact where it is closed."""
    corners = surface.vertices[surface.faces] - surface.bounds.mean(axis=0)
    return float(np.linalg.det(corners).sum() / 6)
