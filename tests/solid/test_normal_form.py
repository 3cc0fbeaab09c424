"""One form for a surface wherever it lies, however large it is, in whatever order it is given."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_meshes import sphere

from objectfolder.making.solid.normal_form import GRID, normal_form
from objectfolder.surface.surface import Surface

VERTICES, FACES = sphere(0.37, 2)
BUMPY = VERTICES * (1 + 0.1 * np.sin(7 * VERTICES[:, :1]) + np.array([0.0, 0.3, 0.5]))
PLAIN = normal_form(Surface(BUMPY, FACES)).surface


def same(surface: Surface) -> bool:
    """Whether the normal form is that of the plain surface, to the bit."""
    form = normal_form(surface).surface
    return np.array_equal(form.vertices, PLAIN.vertices) and np.array_equal(form.faces, PLAIN.faces)


@given(st.integers(-20, 20))
def test_powers_of_two_change_nothing(power):
    assert same(Surface(BUMPY * 2.0**power, FACES))


@pytest.mark.parametrize("scale", [1e-3, 0.1, 3.7, 1e3])
@pytest.mark.parametrize("move", [(0, 0, 0), (0.1, -3.3, 7.7)])
def test_size_and_place_change_nothing(scale, move):
    assert same(Surface((BUMPY + move) * scale, FACES))


@given(st.integers(0, 2**31))
def test_order_changes_nothing(seed):
    random = np.random.default_rng(seed)
    place = random.permutation(len(BUMPY))
    vertices = np.empty_like(BUMPY)
    vertices[place] = BUMPY
    faces = place[FACES][random.permutation(len(FACES))]
    turn = (np.arange(3) + random.integers(3, size=(len(faces), 1))) % 3
    faces = np.take_along_axis(faces, turn, axis=1)
    assert same(Surface(vertices, faces))


def test_it_comes_back_to_metres_and_keeps_its_winding():
    form = normal_form(Surface(BUMPY + 5, FACES))
    assert np.linalg.norm(np.ptp(form.surface.bounds, axis=0)) == pytest.approx(1, abs=4 * GRID)
    back = form.to_metres(form.surface.vertices)
    order = np.lexsort(BUMPY.T[::-1])
    np.testing.assert_allclose(back, BUMPY[order] + 5, atol=2 * GRID * form.diagonal_m)
    centre = back.mean(axis=0)
    volume = np.linalg.det(back[form.surface.faces] - centre).sum()
    np.testing.assert_allclose(volume, np.linalg.det(BUMPY[FACES]).sum(), rtol=1e-5)


def test_faces_smaller_than_the_rounding_go():
    vertices = np.concatenate([BUMPY, BUMPY[:1] + 1e-9, BUMPY[:1] - 1e-9])
    sliver = [[0, len(BUMPY), len(BUMPY) + 1]]
    assert same(Surface(vertices, np.concatenate([FACES, sliver])))
    with pytest.raises(ValueError, match="no face"):
        normal_form(
            Surface(np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0.0], [0, 0, 0]]), [[0, 2, 3]] * 2 + [[0, 1, 2]])
        )
