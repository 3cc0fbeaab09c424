"""Sparse factorisation of symmetric matrices, with the count of negative eigenvalues that comes with it.

By Sylvester's law of inertia the signs of the pivots of K - value M say how many eigenvalues of the pencil
lie below `value` (B. N. Parlett, The Symmetric Eigenvalue Problem, ch. 3). Intel MKL's PARDISO is used where
it is installed, else SuperLU, which takes some four times as long to factorise; `SOLVER` says which.
"""

import ctypes
import importlib.metadata
import importlib.util
import os
import weakref
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from objectfolder.errors import SimulationError, UnsolvableError

Floats = NDArray[np.float64]
Values = NDArray[Any]  # float64 or complex128
Integers = NDArray[np.int64] | NDArray[np.int32]
SOLVER = "PARDISO" if importlib.util.find_spec("pypardiso") else "SuperLU"
POSITIVE_DEFINITE, HERMITIAN_DEFINITE, INDEFINITE, HERMITIAN_INDEFINITE = 2, 4, -2, -4
# Largest relative backward error of a solution at which the signs of pivots count eigenvalues: 1e5 roundings.
MOST_BACKWARD_ERROR = 1e-11
SEQUENTIAL = 1
# Right-hand sides solved for at a time: PARDISO takes memory for each.
RIGHT_SIDES_AT_ONCE = 32
ROWS_AT_ONCE = 16384
ANALYSE, FACTORISE, SOLVE = 11, 22, 33
FROM_ZERO, BLOCK_SIZE = 35, 37  # numbers of PARDISO's parameters
Matrix = sparse.csr_matrix | sparse.bsr_matrix


class Factorisation:
    """Factors of a sparse matrix, real symmetric or complex Hermitian in blocks.

    Of an indefinite one of the latter PARDISO counts the negative pivots only where it stays on the diagonal.
    Where entries grow too much there, the factors are those of its real form, twice as large, which has each
    eigenvalue twice.
    """

    def __init__(
        self,
        matrix: Matrix,
        *,
        definite: bool,
        solver: str = SOLVER,
        most_bytes: float = float("inf"),
    ) -> None:
        """Factorise (n, n), whole or its upper triangle; without interchanges when `definite`.

        Of a matrix in blocks, those on and above the diagonal. PARDISO then orders blocks in place of
        unknowns, in a sixth of the time, and takes two thirds of the memory.

        `most_bytes` limits the memory of the factors, which PARDISO knows before it makes them and SuperLU
        does not.

        Raises
        ------
        UnsolvableError
            When the factors would take more than `most_bytes`.
        SimulationError
            When the matrix is singular, or not definite though said to be.
        """
        self._solver, self._most_bytes = solver, most_bytes
        self._upper = _upper_triangle(matrix)
        self._real_block = 0
        self._factorise(definite)
        is_to_count = not definite and np.iscomplexobj(matrix.data)
        self._sound = is_to_count and self._is_sound()
        if is_to_count and not self._sound:
            if solver == "PARDISO":
                self._release()
            self._real_block = matrix.data.shape[-1]
            self._upper = _real_form(self._upper)
            self._factorise(definite)

    def _factorise(self, definite: bool) -> None:
        try:
            if self._solver == "PARDISO":
                kinds = (INDEFINITE, POSITIVE_DEFINITE)
                if np.iscomplexobj(self._upper.data):
                    kinds = (HERMITIAN_INDEFINITE, HERMITIAN_DEFINITE)
                self._pardiso(kinds[definite])
            else:
                self._super_lu(definite)
        except (RuntimeError, ArithmeticError) as error:
            raise SimulationError(
                "factorisation",
                f"{self._solver} of {self._upper.shape[0]} unknowns: {error}",
                "Check the mesh.",
            ) from error

    def _pardiso(self, kind: int) -> None:
        # Before the import, which looks for MKL as well.
        _say_where_mkl_is()
        from pypardiso.pardiso_wrapper import PyPardisoSolver

        self._factors: Any = PyPardisoSolver(mtype=kind)
        # One thread: the same bytes each time, and no second OpenMP beside that of PyTorch.
        self._factors.libmkl.MKL_Set_Threading_Layer(ctypes.c_int(SEQUENTIAL))
        interchange = int(kind != HERMITIAN_INDEFINITE)
        for parameter, value in ((1, 1), (2, 2), (10, 8), (21, interchange)):
            self._factors.set_iparm(parameter, value)
        self._release = weakref.finalize(self, self._factors.free_memory, everything=True)
        # One-based where it is not set, which costs a copy of all indices in each call.
        self._factors.iparm[FROM_ZERO - 1] = 1
        if self._upper.format == "bsr":
            self._factors.iparm[BLOCK_SIZE - 1] = self._upper.blocksize[0]
        nothing = np.zeros((self._upper.shape[0], 1), self._upper.dtype)
        self._call(ANALYSE, nothing)
        self._refuse_large()
        self._call(FACTORISE, nothing)
        self._perturbed = int(self._factors.get_iparm(14))
        if kind in (POSITIVE_DEFINITE, HERMITIAN_DEFINITE):
            self._forget_matrix()

    def _call(self, phase: int, right: Values) -> Values:
        """Solution (n, k), zero but in a solution, of right-hand sides (n, k) by columns.

        Not by pypardiso's calls: they copy all indices, and know no blocks.

        Raises
        ------
        ArithmeticError
            PARDISO gave up; its number says why.
        """
        pardiso, upper = self._factors, self._upper
        solution = np.zeros(right.shape, right.dtype, order="F")
        size = len(upper.indptr) - 1
        rows, columns = (np.ascontiguousarray(part, dtype=np.int32) for part in (upper.indptr, upper.indices))
        entries = np.ascontiguousarray(upper.data)
        number = ctypes.c_int32(0)

        def integer(value: int) -> Any:
            return ctypes.byref(ctypes.c_int32(value))

        def integers(values: Integers) -> Any:
            return values.ctypes.data_as(ctypes.POINTER(ctypes.c_int32))

        def floats(values: Values) -> Any:
            return values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))

        pardiso._mkl_pardiso(
            pardiso.pt.ctypes.data_as(ctypes.POINTER(ctypes.c_int64)), integer(1), integer(1),
            integer(pardiso.mtype), integer(phase), integer(size), floats(entries), integers(rows),
            integers(columns), integers(pardiso.perm), integer(right.shape[1]), integers(pardiso.iparm),
            integer(0), floats(right), floats(solution), ctypes.byref(number),
        )  # fmt: skip
        if number.value:
            raise ArithmeticError(f"PARDISO gave up with error {number.value}")
        return np.ascontiguousarray(solution)

    def _forget_matrix(self) -> None:
        """Drop the entries of the matrix: they and their copy in a solution take a fifth of all memory.

        Solving reads them for iterative refinement alone, which PARDISO makes where it moved a pivot.
        """
        if self._solver == "PARDISO" and self._perturbed == 0:
            upper = self._upper
            entries, columns = np.zeros((0, *upper.data.shape[1:]), upper.dtype), np.zeros(0, dtype=np.int32)
            self._upper = type(upper)((entries, columns, np.zeros_like(upper.indptr)), shape=upper.shape)

    def _refuse_large(self) -> None:
        """Raise `UnsolvableError` where the analysis foretells more memory than there may be."""
        # In units of 1024 bytes: what the analysis keeps, and what the factors and solutions take.
        needed = 1024 * (int(self._factors.get_iparm(16)) + int(self._factors.get_iparm(17)))
        if needed > self._most_bytes:
            raise UnsolvableError(
                "factorisation",
                f"factors of {self._upper.shape[0]} unknowns take {needed / 1e9:.2g} GB, more than "
                f"{self._most_bytes / 1e9:.2g}",
                "Simplify the surface, or state a larger memory_limit_gb",
            )

    def _super_lu(self, definite: bool) -> None:
        upper = _upper_triangle(self._upper.tocsr())
        self._factors = splu(
            (upper + upper.conj().T - sparse.diags(upper.diagonal())).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        if definite and (self._interchanged() or (self._factors.U.diagonal().real <= 0).any()):
            raise ArithmeticError("a pivot is not positive, though the matrix should be definite")

    def _interchanged(self) -> bool:
        """Whether SuperLU left the diagonal, so that its pivots say nothing of the inertia."""
        return not np.array_equal(self._factors.perm_r, self._factors.perm_c)

    def solve(self, right: Values) -> Values:
        """Solution (n, k) for right-hand sides (n, k)."""
        block = self._real_block
        if not block:
            return self._solve(right)
        parts = right.reshape(-1, block, right.shape[1])
        real = self._solve(np.stack([parts.real, parts.imag], axis=1).reshape(-1, right.shape[1]))
        both = real.reshape(-1, 2, block, right.shape[1])
        return np.asarray(both[:, 0] + 1j * both[:, 1]).reshape(right.shape)

    def _solve(self, right: Values) -> Values:
        if self._solver != "PARDISO":
            return np.asarray(self._factors.solve(right))
        if right.shape[1] <= RIGHT_SIDES_AT_ONCE:
            return self._call(SOLVE, np.asfortranarray(right, dtype=self._upper.dtype))
        parts = (
            slice(first, first + RIGHT_SIDES_AT_ONCE)
            for first in range(0, right.shape[1], RIGHT_SIDES_AT_ONCE)
        )
        return np.concatenate([self._solve(right[:, columns]) for columns in parts], axis=1)

    def backward_error(self) -> float:
        """|A x - b| / (|A| |x| + |b|) of a random b, |A| in the maximum norm (J. L. Rigal and J. Gaches).

        Of an indefinite matrix whose eigenvalues were not counted yet: later its entries are gone.
        """
        if self._upper.nnz == 0:
            raise ValueError("the entries of the matrix are gone; ask before counting, of an indefinite one")
        size = self._upper.shape[0]
        right = np.random.default_rng(0).standard_normal((size, 1))
        solution = self._solve(right)
        sums, wrong = np.zeros(size), -right.astype(self._upper.dtype)
        for rows, upper in self._rows():
            diagonal = upper.diagonal(rows.start)
            entries = abs(upper)  # of some rows: a copy of all would be much of the memory
            sums[rows] += entries.sum(axis=1).A1 - np.abs(diagonal)
            sums += entries.sum(axis=0).A1
            wrong[rows] += upper @ solution - diagonal[:, None] * solution[rows]
            wrong += upper.conj().T @ solution[rows]
        scale = sums.max() * np.linalg.norm(solution) + np.linalg.norm(right)
        return float(np.linalg.norm(wrong) / scale)

    def _rows(self) -> Iterator[tuple[slice, sparse.csr_matrix]]:
        """Parts (m, n) of the upper triangle of the matrix, and their rows."""
        upper = self._upper
        block = upper.blocksize[0] if upper.format == "bsr" else 1
        for first in range(0, len(upper.indptr) - 1, ROWS_AT_ONCE // block):
            starts = upper.indptr[first : first + ROWS_AT_ONCE // block + 1]
            entries = slice(starts[0], starts[-1])
            rows = slice(block * first, block * (first + len(starts) - 1))
            part = type(upper)(
                (upper.data[entries], upper.indices[entries], starts - starts[0]),
                shape=(rows.stop - rows.start, upper.shape[1]),
            )
            yield rows, sparse.triu(part, rows.start, format="csr")

    def negative(self) -> int:
        """Number of negative eigenvalues of an indefinite matrix, asked for once.

        The factors are exactly those of a matrix near to the one given. SuperLU keeps to the diagonal and
        PARDISO interchanges within blocks only, so that entries may grow, and the matrix may be far from it:
        a solution then has a large backward error.

        Raises
        ------
        SimulationError
            When a pivot vanished, or the backward error is above `MOST_BACKWARD_ERROR`: the signs prove
            nothing.
        """
        if not (self._sound or self._is_sound()):
            raise SimulationError(
                "count of modes", "a pivot nearly vanished", "Move the frequency limit off an eigenfrequency."
            )
        if self._solver == "PARDISO":
            count = int(self._factors.get_iparm(23))
        else:
            count = int(np.count_nonzero(self._factors.U.diagonal().real < 0))
        self._forget_matrix()
        return count // 2 if self._real_block else count

    def _is_sound(self) -> bool:
        """Whether the signs of the pivots count eigenvalues."""
        vanished = self._perturbed > 0 if self._solver == "PARDISO" else self._interchanged()
        return not vanished and self.backward_error() <= MOST_BACKWARD_ERROR


def shifted(stiffness: sparse.bsr_matrix, mass: sparse.csr_matrix, value: float) -> sparse.bsr_matrix:
    """K - value M, (3 n, 3 n), in blocks on and above the diagonal, for blocks of K where M has entries.

    The other half would take memory beside the factors. The mass is that of one axis (n, n), or (3 n, 3 n).
    """
    if mass.shape == stiffness.shape:
        return sparse.bsr_matrix(_upper_triangle(stiffness - value * mass.tobsr(stiffness.blocksize)))
    upper = _on_and_above(mass)
    blocks = stiffness.data[upper]
    blocks[:, range(3), range(3)] -= value * mass.data[upper, None]
    starts = np.concatenate([[0], np.cumsum(upper)])[mass.indptr]
    return sparse.bsr_matrix((blocks, mass.indices[upper], starts), shape=stiffness.shape)


def _real_form(matrix: Matrix) -> sparse.bsr_matrix:
    """Blocks [[A, -B], [B, A]] for blocks A + i B."""
    real, imaginary = matrix.data.real, matrix.data.imag
    blocks = np.concatenate(
        [np.concatenate([real, -imaginary], axis=2), np.concatenate([imaginary, real], axis=2)], axis=1
    )
    shape = (2 * matrix.shape[0], 2 * matrix.shape[1])
    return sparse.bsr_matrix((blocks, matrix.indices, matrix.indptr), shape=shape)


def _on_and_above(matrix: Matrix) -> NDArray[np.bool_]:
    """Whether each entry, or block, lies on or above the diagonal."""
    rows = np.repeat(np.arange(len(matrix.indptr) - 1, dtype=matrix.indices.dtype), np.diff(matrix.indptr))
    return np.asarray(matrix.indices >= rows)


def _upper_triangle(matrix: Matrix) -> Matrix:
    """Entries, or blocks, on and above the diagonal, by ascending column."""
    if not matrix.has_sorted_indices:
        matrix = matrix.sorted_indices()
    upper = _on_and_above(matrix)
    if upper.all():
        return matrix
    starts = np.concatenate([[0], np.cumsum(upper)])[matrix.indptr]
    return type(matrix)((matrix.data[upper], matrix.indices[upper], starts), shape=matrix.shape)


@cache
def _say_where_mkl_is() -> None:
    """Spare pypardiso the search of all installed files, which it makes for every matrix."""
    if "PYPARDISO_MKL_RT" in os.environ:
        return
    try:
        files = importlib.metadata.files("mkl") or []
    except importlib.metadata.PackageNotFoundError:
        # MKL that did not come from PyPI: pypardiso looks for it in its own places.
        return
    for file in files:
        if "mkl_rt" in file.name:
            os.environ["PYPARDISO_MKL_RT"] = str(file.locate())
            return
