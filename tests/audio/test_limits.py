"""No solution without an end: memory and time are limited, and what is reached is said with a remedy."""

import numpy as np
import pytest
from scipy import sparse
from structured_solids import box

from objectfolder.errors import SimulationError, UnsolvableError
from objectfolder.making.elements.elasticity import ElementMatrices
from objectfolder.making.factorisation import SOLVER, Factorisation
from objectfolder.making.modes.adaptive import Goal, adapt_spectrum
from objectfolder.making.modes.eigen import DENSE, lowest_elastic
from objectfolder.making.modes.limits import NO_LIMITS, Limits
from objectfolder.making.modes.spectrum import Spectrum, pencil_of, space_on

MODES = 20


def plate_with(limits: Limits = NO_LIMITS, max_unknowns: int = 10**6) -> Spectrum:
    plate = box((5, 5, 1), (1, 1, 0.02))
    goal = Goal(np.inf, 8.0, MODES, max_unknowns, 0, limits)
    return adapt_spectrum(space_on(plate, 4, 1.0)[0], plate.component, 0.3, goal)


@pytest.mark.skipif(SOLVER != "PARDISO", reason="SuperLU does not foretell the memory of its factors")
def test_factors_that_take_too_much_memory_are_refused_before_they_are_made() -> None:
    side = sparse.diags([-1, 2.1, -1], [-1, 0, 1], shape=(20, 20))
    cube = sparse.kronsum(sparse.kronsum(side, side), side).tocsr()
    assert np.isfinite(Factorisation(cube, definite=True, most_bytes=1e9).solve(np.ones((8000, 1)))).all()
    with pytest.raises(UnsolvableError, match=r"factors of 8000 unknowns take 0\.\d+ GB, more than 0\.001"):
        Factorisation(cube, definite=True, most_bytes=1e6)


def test_blocks_of_vectors_take_their_share_of_the_memory() -> None:
    """Four blocks of 200 modes in 1 GB are 468,750 numbers each, and fewer unknowns than may be."""
    few, many = (Goal(1.0, 5.0, 200, most, 0, Limits(memory_gb=3.0)) for most in (30_000, 10**6))
    assert (few.most_functions(200), many.most_functions(200)) == (10_000, 156_250 // 3)


class FewVectors(Limits):
    """Room for a basis of 85 vectors of 1,200 unknowns."""

    vector_values = 2 * 1200 * 85.0


def test_a_short_basis_finds_the_same_modes() -> None:
    plate = box((5, 5, 1), (1, 1, 0.1))
    space = space_on(plate, 3, 1.0)[0]
    matrices, every = ElementMatrices(space, 0.3), np.ones(space.size, dtype=bool)
    pencils = [pencil_of(matrices, plate.component, every, limits) for limits in (NO_LIMITS, FewVectors())]
    assert pencils[0].size > DENSE
    whole, short = (lowest_elastic(pencil, below=np.inf, at_most=10, shift=-0.05) for pencil in pencils)
    np.testing.assert_allclose(short.values, whole.values, rtol=1e-9)


def test_a_body_that_is_too_much_for_the_lowest_order_is_refused_on_any_machine() -> None:
    with pytest.raises(UnsolvableError, match=r"elements have \d+ unknowns of order 2, more than max_unk"):
        plate_with(max_unknowns=300)


def test_a_solution_out_of_time_is_no_silent_object() -> None:
    with pytest.raises(SimulationError, match="more than its time limit") as slow:
        plate_with(Limits(ends_s=0.0))
    assert not isinstance(slow.value, UnsolvableError)
