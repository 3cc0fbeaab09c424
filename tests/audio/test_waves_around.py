"""Waves around the axis, each on one sector, are together the modes of the whole body."""

import numpy as np
import pytest

from objectfolder.making.elements.elasticity import ElementMatrices
from objectfolder.making.elements.sectors import Sectors, SectorSpace, sectors_of
from objectfolder.making.elements.space import Space
from objectfolder.making.modes.adaptive import Goal
from objectfolder.making.modes.eigen import Eigenpairs, weigh
from objectfolder.making.modes.spectrum import Spectrum, pencil_of, solve_spectrum
from objectfolder.making.modes.waves_around import wave_spectrum
from objectfolder.making.solid.revolution import Revolution
from objectfolder.making.solid.revolved import revolved_walls

POISSON_RATIO = 0.3


def sectors(profile: np.ndarray, looped: bool, longest: float, order: int = 3) -> Sectors:
    """Of the elements of a body of revolution, of which all edges are bent a little, alike in each sector."""
    body = Revolution(np.eye(3), np.array([0.1, 0.2, 0.3]), profile, looped)
    walls = revolved_walls(body, lambda wall: np.full(len(wall), longest))
    assert walls is not None
    vertices, tetrahedra, _, count = walls
    space = Space.on(vertices, tetrahedra, order)
    geometry = space.geometry.copy()
    geometry[len(vertices) : np.searchsorted(space.orders, 3)] = [0.0, 0.0, 1e-3]
    result = sectors_of(space.shaped(geometry), vertices, body.centre, body.frame[2], count)
    assert result is not None
    return result


def bowl() -> Sectors:
    angle = np.linspace(0, 1.3, 13)
    outer, inner = (r * np.stack([np.sin(angle), -np.cos(angle)], axis=1) for r in (0.5, 0.45))
    outer[0, 0] = inner[0, 0] = 0.0
    return sectors(np.concatenate([outer, inner[::-1]]), False, 0.4)


def ring() -> Sectors:
    return sectors(np.array([[0.35, 0.0], [0.4, 0.0], [0.4, 0.2], [0.35, 0.2]]), True, 0.4)


def of_waves(body: Sectors, below: float, max_modes: int = 100) -> Spectrum:
    """In all functions: no accuracy is enough."""
    return wave_spectrum(body, POISSON_RATIO, Goal(below, 1e-9, max_modes, 180_000, seed=0))


@pytest.mark.parametrize(("body", "below"), [(bowl(), 14.0), (ring(), 12.0)], ids=["bowl", "ring"])
def test_waves_make_the_spectrum_of_the_whole(body: Sectors, below: float) -> None:
    component = np.zeros(body.whole.vertex_count, dtype=np.int64)
    whole = solve_spectrum(body.whole, component, POISSON_RATIO, below=below, max_modes=100, seed=0)
    waves = of_waves(body, below)
    assert len(whole.eta_squared) > 8
    np.testing.assert_allclose(waves.eta_squared, whole.eta_squared, rtol=1e-6)
    assert waves.certificate["counted"] == whole.certificate["counted"]
    assert waves.volume == pytest.approx(whole.volume, rel=1e-12)

    every = np.ones(body.whole.size, dtype=bool)
    pencil = pencil_of(ElementMatrices(body.whole, POISSON_RATIO), component, every)
    modes = Eigenpairs(waves.eta_squared, waves.vectors.reshape(3 * body.whole.size, -1))
    assert pencil.residuals(modes).max() < 2e-4
    gram = modes.vectors.T @ weigh(pencil.mass, modes.vectors)
    np.testing.assert_allclose(gram, np.eye(len(gram)), atol=1e-6)
    apart = np.diff(waves.eta_squared) / waves.eta_squared[1:]
    assert np.count_nonzero(apart == 0) >= 3  # pairs


def test_the_band_ends_in_a_gap_where_there_are_more_modes() -> None:
    body = ring()
    every = of_waves(body, 20.0)
    some = of_waves(body, 20.0, max_modes=len(every.eta_squared) - 3)
    count = len(some.eta_squared)
    assert 0 < count <= len(every.eta_squared) - 3
    np.testing.assert_allclose(some.eta_squared, every.eta_squared[:count], rtol=1e-6)
    assert every.eta_squared[count - 1] < some.limit < every.eta_squared[count]


def test_rigid_motions_of_waves_cost_no_energy() -> None:
    body = bowl()
    ranks = []
    for wave in body.waves:
        space = SectorSpace.of(body, wave)
        every = np.ones(space.size, dtype=bool)
        component = np.zeros(space.vertex_count, dtype=np.int64)
        pencil = pencil_of(ElementMatrices(space, POISSON_RATIO), component, every)
        ranks.append(pencil.rigid.shape[1])
        assert np.abs(pencil.stiffness @ pencil.rigid).max(initial=0.0) < 1e-9
    assert ranks == [2, 2] + [0] * (len(ranks) - 2)


def test_elements_that_do_not_repeat_have_no_sectors() -> None:
    body = bowl()
    straight = body.whole.geometry[: body.whole.vertex_count].copy()
    straight[np.abs(straight[:, 0]).argmax()] *= 1.01
    plain = Space.on(straight, body.whole.tetrahedra, 2)
    assert sectors_of(plain, straight, body.point, body.axis, body.count) is None
