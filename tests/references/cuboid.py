"""Free vibrations of a homogeneous cuboid: three-dimensional Rayleigh-Ritz on products of polynomials.

The three mirror planes part the problem into eight classes (H. H. Demarest, J. Acoust. Soc. Am. 49, 1971).
Along each edge the functions are polynomials of the half edge in two pieces, the outer one as long as the
body is thin: the state of stress near the rim of a plate changes within its thickness. Beams, plates and
cubes are cuboids; nothing else is assumed of their proportions.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, eigh, solve_triangular
from scipy.sparse.linalg import LinearOperator, eigsh

from objectfolder.errors import SimulationError
from tests.references.spectrum import ReferenceSpectrum

Floats = NDArray[np.float64]
Lengths = tuple[float, float, float]
Parity = tuple[int, int, int]
FIRST_DEGREE, LAST_DEGREE = 4, 16
MOST_UNKNOWNS = 9000  # of one class
# Neighbours closer than this, relatively, or than three times the convergence, are one multiple mode.
SAME = 1e-7
PARITIES: tuple[Parity, ...] = tuple((a, b, c) for a, b, c in product((0, 1), repeat=3))


def lame_wavenumbers(edge: float, count: int) -> Floats:
    """The first `count` wavenumbers omega / c_s of Lame's modes of a cube, m pi sqrt(2) / edge, for any nu.

    u = (cos(k x) sin(k y), -sin(k x) cos(k y), 0), k = m pi / edge, has no divergence and no traction on the
    faces (G. Lame, Lecons sur la theorie mathematique de l'elasticite, 1852). Each is at least threefold.
    """
    return np.arange(1, count + 1) * np.pi * np.sqrt(2) / edge


def cuboid(
    lengths: Lengths, poisson_ratio: float, limit: float, *, tolerance: float = 2e-6
) -> ReferenceSpectrum:
    """Every elastic mode of a free cuboid with omega / c_s below `limit`.

    Parameters
    ----------
    lengths
        Edges, in the unit of length.
    poisson_ratio
        In (-1, 0.5).
    limit
        Radians per unit of length.
    tolerance
        Largest relative change of a wavenumber when all degrees grow by one; the finer result is returned,
        and the change as `convergence`.

    Raises
    ------
    ValueError
        For a length that is not positive or a Poisson ratio outside (-1, 0.5).
    SimulationError
        When polynomials of degree `LAST_DEGREE` or `MOST_UNKNOWNS` unknowns of one class do not suffice.
    """
    if min(lengths) <= 0:
        raise ValueError(f"lengths {lengths} are not all positive")
    if not -1 < poisson_ratio < 0.5:
        raise ValueError(f"Poisson ratio {poisson_ratio} is outside (-1, 0.5)")
    coarse = None
    for degree in range(FIRST_DEGREE, LAST_DEGREE + 1):
        fine = _wavenumbers(lengths, poisson_ratio, 1.1 * limit, degree)
        change = np.inf if coarse is None else max(map(_change, coarse, fine, [limit] * 8))
        if change <= tolerance:
            return _merged(fine, limit, change)
        coarse = fine
    raise SimulationError(
        f"cuboid {lengths}", f"degree {LAST_DEGREE} leaves a change of {change:.1e}", "Lower the limit."
    )


@dataclass(frozen=True)
class EdgeFunctions:
    """Functions of one parity along an edge, orthonormal on it.

    Attributes
    ----------
    values, slopes : (functions, points) at the quadrature points of the half edge
    weights : (points,), of the whole edge
    """

    values: Floats
    slopes: Floats
    weights: Floats

    @classmethod
    def along(cls, length: float, layer: float, degree: int, parity: int) -> "EdgeFunctions":
        """Even (parity 0) or odd (1) functions of the distance from the middle of an edge.

        Parameters
        ----------
        layer
            Length of the outer piece; none where it would reach half way to the middle.
        degree
            Of the outer piece; half as much again further in, where modes turn.
        """
        half = length / 2
        if layer > half / 2:
            order = 2 * degree if layer < length else degree + 2
            return cls._orthonormal([(0.0, half, order)], parity)
        return cls._orthonormal(
            [(0.0, half - layer, degree + degree // 2), (half - layer, half, degree)], parity
        )

    @classmethod
    def _orthonormal(cls, pieces: list[tuple[float, float, int]], parity: int) -> "EdgeFunctions":
        nodes, weights = legendre.leggauss(max(order for *_, order in pieces) + 2)
        count = len(nodes)
        functions: list[Floats] = []
        slopes: list[Floats] = []
        for index, (start, end, order) in enumerate(pieces):
            span = slice(index * count, (index + 1) * count)
            for term in range(order + 1):
                value, slope = np.zeros(count * len(pieces)), np.zeros(count * len(pieces))
                if len(pieces) == 1 and term % 2 != parity:
                    continue  # on the whole edge: even or odd powers
                if len(pieces) == 1:
                    series = np.eye(term + 1)[term]
                    value[span] = legendre.legval((nodes + 1) / 2, series)
                    slope[span] = legendre.legval((nodes + 1) / 2, legendre.legder(series)) / end
                elif term < 2:
                    # Two half hats at the common point are one function.
                    value[span] = (1 - nodes) / 2 if term == 0 else (1 + nodes) / 2
                    slope[span] = (2 * term - 1) / (end - start)
                    if index == 1 and term == 0:
                        functions[1] += value
                        slopes[1] += slope
                        continue
                else:
                    bubble = legendre.legint(np.eye(term)[term - 1], lbnd=-1)
                    value[span] = legendre.legval(nodes, bubble)
                    slope[span] = legendre.legval(nodes, legendre.legder(bubble)) * 2 / (end - start)
                functions.append(value)
                slopes.append(slope)
        if len(pieces) > 1 and parity:
            functions, slopes = functions[1:], slopes[1:]  # an odd function is zero in the middle
        # The half edge counts twice.
        rule = np.concatenate([weights * (end - start) for start, end, _ in pieces])
        raw, raw_slopes = np.array(functions), np.array(slopes)
        scale = 1 / np.sqrt((raw**2) @ rule)
        raw, raw_slopes = scale[:, None] * raw, scale[:, None] * raw_slopes
        lower = np.linalg.cholesky((raw * rule) @ raw.T)
        return cls(
            solve_triangular(lower, raw, lower=True), solve_triangular(lower, raw_slopes, lower=True), rule
        )


def class_stiffness(lengths: Lengths, poisson_ratio: float, degree: int, parity: Parity) -> Floats:
    """Stiffness of one symmetry class, mu = 1, for functions of unit mass at density 1.

    Component a has in direction d the parity `parity[d]`, the other one where a = d.
    """
    lame = 2 * poisson_ratio / (1 - 2 * poisson_ratio)
    layer = min(lengths)
    along = [[EdgeFunctions.along(length, layer, degree, q) for q in (0, 1)] for length in lengths]
    used = [[along[d][(parity[d] + (a == d)) % 2] for d in range(3)] for a in range(3)]

    def integral(a: int, da: int, b: int, db: int) -> Floats:
        """Integral of d_da N_i d_db N_j, N_i of component a and N_j of component b."""
        result = np.ones((1, 1))
        for d in range(3):
            left = used[a][d].slopes if d == da else used[a][d].values
            right = used[b][d].slopes if d == db else used[b][d].values
            result = np.kron(result, (left * used[a][d].weights) @ right.T)
        return result

    blocks = [[lame * integral(a, a, b, b) + integral(a, b, b, a) for b in range(3)] for a in range(3)]
    for a in range(3):
        blocks[a][a] = blocks[a][a] + sum(integral(a, d, a, d) for d in range(3))
    return np.block(blocks)


def _wavenumbers(lengths: Lengths, poisson_ratio: float, limit: float, degree: int) -> list[Floats]:
    """Elastic wavenumbers of each of the eight classes below `limit`."""
    spectra: dict[tuple[tuple[float, int], ...], Floats] = {}
    classes = []
    for parity in PARITIES:
        # Classes that differ by an exchange of equal edges have the same modes.
        key = tuple(sorted(zip(lengths, parity, strict=True)))
        if key not in spectra:
            stiffness = class_stiffness(lengths, poisson_ratio, degree, parity)
            if len(stiffness) > MOST_UNKNOWNS:
                raise SimulationError(
                    f"cuboid {lengths}", f"{len(stiffness)} unknowns of one class", "Lower the limit."
                )
            rigid = 1 if sum(parity) in (1, 2) else 0  # a translation, a rotation
            squared = _below(stiffness, limit**2)[rigid:]
            spectra[key] = np.sqrt(squared)
        classes.append(spectra[key])
    return classes


def _below(matrix: Floats, limit: float) -> Floats:
    """Eigenvalues of a symmetric matrix below `limit`, ascending."""
    size = len(matrix)
    count = 12
    if size > 400:
        shift = 0.05 * limit
        shifted = matrix.copy()
        shifted[np.diag_indices(size)] += shift
        factors = cho_factor(shifted, lower=True, overwrite_a=True)
        inverse = LinearOperator((size, size), matvec=lambda x: cho_solve(factors, x), dtype=np.float64)
        start = np.random.default_rng(0).standard_normal(size)
        while count < size // 4:
            values = np.sort(
                eigsh(matrix, count, sigma=-shift, OPinv=inverse, v0=start, return_eigenvectors=False)
            )
            if values[-1] > limit:
                return values[values < limit]
            count *= 2
    return eigh(matrix, eigvals_only=True, subset_by_value=(-np.inf, limit))


def _change(old: Floats, new: Floats, limit: float) -> float:
    """Largest relative change of the modes below `limit`, infinite where some are new."""
    count = int(np.count_nonzero(new < limit))
    if len(old) < count:
        return np.inf
    return float(np.max(np.abs(old[:count] / new[:count] - 1), initial=0.0))


def _merged(classes: list[Floats], limit: float, convergence: float) -> ReferenceSpectrum:
    """One list of all classes; equal wavenumbers of different classes are one of a multiplicity."""
    labelled = sorted(
        (float(value), "".join(map(str, parity)))
        for parity, values in zip(PARITIES, classes, strict=True)
        for value in values
    )
    modes: list[tuple[float, int, str]] = []
    for value, name in labelled:
        if modes and value - modes[-1][0] <= max(SAME, 3 * convergence) * value:
            first, count, names = modes[-1]
            modes[-1] = (first, count + 1, f"{names} {name}")
        else:
            modes.append((value, 1, name))
    return ReferenceSpectrum.collect(modes, limit, convergence)
