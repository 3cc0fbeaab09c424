"""LOBPCG, the eigensolver of NeuralSound, on its voxels.

NeuralSound (X. Jin, S. Li, G. Wang and D. Manocha, ACM Trans. Graph. 41, 2022) takes 20 modes of 32^3
trilinear hexahedra by LOBPCG in double precision on a graphics card, started from vectors that a sparse
convolution network (single precision) guesses from random ones: a trained start is what makes few iterations
do. Here it is SciPy's LOBPCG on one core from random vectors, so what is compared is the iteration, not the
network; preconditioned by the diagonal, or by an incomplete factorisation, which the network stands in for.
"""

import warnings

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, lobpcg, spilu

from bench.record import Stopwatch
from bench.rivals.audio import voxels
from bench.rivals.audio.outcome import Outcome
from bench.rivals.audio.voxel_grid import voxelise
from objectfolder.audio.materials import Material
from objectfolder.surface.surface import Surface

MODES = 20
PRECONDITIONERS = ("diagonal", "incomplete LU")
MAX_ITERATIONS = 400
# Of the residual in the units of the stiffness, whose diagonal is scaled to 1.
TOLERANCE = 1e-6


def on_voxels(
    surface: Surface, material: Material, resolution: int, preconditioner: str, modes: int = MODES
) -> Outcome:
    """First elastic modes of the cubes that a surface touches; cubes that meet in an edge stay hinged."""
    watch = Stopwatch()
    with watch.step("meshing"):
        grid = voxelise(surface, resolution, "touch")
    with watch.step("assembly"):
        cells = np.argwhere(grid.full)
        corners = cells[:, None] + voxels.CORNERS
        base = np.array(grid.full.shape) + 1
        _, hexahedra = np.unique(np.ravel_multi_index(corners.reshape(-1, 3).T, base), return_inverse=True)
        hexahedra = hexahedra.reshape(-1, 8)
        stiffness, mass = voxels.assemble(
            hexahedra, int(hexahedra.max()) + 1, *voxels.hexahedron(material.poisson_ratio)
        )
    return _solve(stiffness, mass, 6, material.shear_speed_m_s / grid.edge_m, preconditioner, modes, watch)


def _solve(
    stiffness: sparse.bsr_matrix,
    mass: sparse.csr_matrix,
    rigid: int,
    radians: float,
    preconditioner: str,
    modes: int,
    watch: Stopwatch,
) -> Outcome:
    size = stiffness.shape[0]
    with watch.step("preconditioner"):
        # Scaled to a unit diagonal: then the diagonal is the preconditioner.
        scale = sparse.diags(1 / np.sqrt(stiffness.diagonal()))
        scaled = (scale @ stiffness @ scale).tocsr()
        weights = (scale @ sparse.kron(mass, sparse.identity(3), format="csr") @ scale).tocsr()
        approximate = None
        if preconditioner == "incomplete LU":
            factors = spilu((scaled + 1e-3 * sparse.identity(size)).tocsc(), drop_tol=1e-3, fill_factor=8)
            approximate = LinearOperator(
                (size, size), matvec=factors.solve, matmat=factors.solve, dtype=np.float64
            )
    start = np.random.default_rng(0).standard_normal((size, modes + rigid))
    with watch.step("eigenvectors"), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # short of the tolerance: said by the residual
        values, _, history = lobpcg(
            scaled,
            start,
            B=weights,
            M=approximate,
            tol=TOLERANCE,
            maxiter=MAX_ITERATIONS,
            largest=False,
            retResidualNormsHistory=True,
        )
    squared = np.sort(np.asarray(values))[rigid:]
    return Outcome(
        np.sqrt(np.maximum(squared, 0.0)) * radians / (2 * np.pi),
        size,
        watch.cpu_s,
        {
            "preconditioner": preconditioner,
            "iterations": len(history) - 1,
            "converged": bool(np.max(history[-1]) <= TOLERANCE),
            "largest_residual": float(np.max(history[-1])),
        },
    )
