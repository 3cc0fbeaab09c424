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
from objectfolder.errors import SimulationError
from objectfolder.making.materials import Material
from objectfolder.making.modes.eigen import DENSE, Pencil, count_below, lowest_elastic, rigid_motions
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])


@dataclass(frozen=True)
class VoxelModes:
    """Elastic modes of a body of cubes.

    Attributes
    ----------
    eigenvalues : (modes,) float64 undamped lambda = omega^2, rad^2/s^2, ascending; all below the limit
    components : bodies joined through faces
    mass_ratio : volume of the cubes over that within the surface; None where the surface encloses none
    unknowns : three a vertex
    cells : full cubes
    cpu_s : CPU seconds of the steps ``voxelise``, ``assemble``, ``solve`` and ``count``
    """

    eigenvalues: Floats
    components: int
    mass_ratio: float | None
    unknowns: int
    cells: int
    cpu_s: dict[str, float]


def voxel_modes(
    surface: Surface,
    material: Material,
    *,
    resolution: int = 32,
    rule: str = "touch",
    max_frequency_hz: float = 20000.0,
    max_modes: int = 256,
) -> VoxelModes:
    """Elastic modes below a frequency of the cubes that stand for a surface.

    Parameters
    ----------
    surface
        Metres, faces outward.
    resolution, rule
        See `voxelise`.
    max_modes
        Of a body joined through faces.

    Raises
    ------
    InputError
        From `voxelise`.
    SimulationError
        When the inertia count and the modes of a body differ after a second search.
    """
    watch = Stopwatch()
    with watch.step("voxelise"):
        grid = voxelise(surface, resolution, rule)
        hexahedra, nodes, body = _mesh(grid)
    # Lengths in cells and the mass of one cell as 1: omega^2 = eta^2 (c_s / edge)^2.
    radians = material.shear_speed_m_s / grid.edge_m
    below = (2 * np.pi * max_frequency_hz / radians) ** 2
    blocks = hexahedron(material.poisson_ratio)
    order = np.argsort(body[hexahedra[:, 0]], kind="stable")
    ends = np.cumsum(np.bincount(body[hexahedra[:, 0]], minlength=int(body.max()) + 1))
    values = []
    for cells in np.split(order, ends[:-1]):
        members, local = np.unique(hexahedra[cells], return_inverse=True)
        with watch.step("assemble"):
            stiffness, mass = assemble(local.reshape(-1, 8), len(members), *blocks)
        positions = nodes[members] - nodes[members].mean(axis=0)
        values.append(_solve(stiffness, mass, positions, below, max_modes, watch))
    enclosed = _enclosed_volume(surface)
    return VoxelModes(
        eigenvalues=np.sort(np.concatenate(values)) * radians**2,
        components=len(values),
        mass_ratio=len(hexahedra) * grid.edge_m**3 / enclosed if enclosed > 0 else None,
        unknowns=3 * len(nodes),
        cells=len(hexahedra),
        cpu_s=watch.cpu_s,
    )


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
    watch: Stopwatch,
) -> Floats:
    """Elastic eigenvalues of one body below a limit, all of them."""
    one_body = np.zeros(len(positions), dtype=np.int64)
    pencil = Pencil(stiffness, mass, rigid_motions(positions, one_body, len(positions), mass))
    longest = float(np.ptp(positions, axis=0).max())
    for seed, tolerance in enumerate((1e-7, 1e-11)):
        with watch.step("solve"):
            values = lowest_elastic(
                pencil,
                below=below,
                at_most=max_modes,
                shift=-min(0.05 / longest**2, below / 4),
                tolerance=tolerance,
                seed=seed,
            ).values
        mode_count = int(np.count_nonzero(values < below))
        with watch.step("count"):
            # Of a small pencil all eigenvalues were computed.
            counted = count_below(pencil, below) if pencil.size > DENSE else mode_count
        if counted == mode_count:
            return values[:mode_count]
    raise SimulationError(
        "voxel modes",
        f"inertia counts {counted} elastic modes, {mode_count} were found",
        "Lower the frequency limit or allow more modes.",
    )


def _enclosed_volume(surface: Surface) -> float:
    """Signed volume within the surface, exact where it is closed."""
    corners = surface.vertices[surface.faces] - surface.bounds.mean(axis=0)
    return float(np.linalg.det(corners).sum() / 6)
