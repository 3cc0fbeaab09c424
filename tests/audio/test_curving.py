"""Elements bent onto a surface."""

import numpy as np
import pytest
from structured_solids import ball, box

from objectfolder.making.elements.curving import LEAST_JACOBIAN, _unfold, curve, least_jacobian
from objectfolder.making.elements.elasticity import chunks, element_integrals
from objectfolder.making.elements.hierarchic import differentiate, quadrature
from objectfolder.making.elements.space import Space
from objectfolder.making.modes.boundary import Boundary
from objectfolder.making.modes.spectrum import solve_spectrum, space_on
from objectfolder.making.solid.solid import Solid, clean
from objectfolder.surface.surface import Surface


def volume(space: Space) -> float:
    return float(sum(element_integrals(space, chunk)[1][:, :4, :4].sum() for chunk in chunks(space)))


@pytest.fixture(scope="module")
def solid() -> Solid:
    return ball(1)


def test_a_bent_ball_has_the_volume_and_radius_of_its_target() -> None:
    solid = ball(2)
    bent, report = space_on(solid, 3, 1.0, bend=True)
    assert report["curved_elements"] > 0
    heights = np.linalg.norm(Boundary(solid, bent, 1.0).surface.vertices, axis=1) - 1
    # Of the target's own 20,480 triangles it is 2e-4, of straight elements 1e-2.
    assert np.sqrt(np.mean(heights**2)) < 1e-4
    assert volume(bent) == pytest.approx(4 * np.pi / 3, rel=1e-3)


@pytest.mark.slow
def test_a_bent_ball_rings_as_lamb_says_and_keeps_six_rigid_motions(solid: Solid) -> None:
    """H. Lamb 1882, nu 0.25: eta = 2.501133 and 2.639869, five-fold each."""
    bent, _ = space_on(solid, 3, 1.0, bend=True)
    spectrum = solve_spectrum(bent, solid.component, 0.25, below=9.0, max_modes=30, seed=0)
    assert spectrum.certificate["counted"] == 16
    assert spectrum.rigid_eta_squared < 1e-9
    eta = np.sqrt(spectrum.eta_squared)
    np.testing.assert_allclose(eta, np.repeat([2.501133, 2.639869], 5), rtol=1e-3)


def test_flat_faces_stay_flat() -> None:
    coarse, fine = box((2, 2, 1), (1, 1, 0.4)), box((6, 6, 3), (1, 1, 0.4))
    faces, _, _ = coarse.boundary()
    space = Space.on(coarse.vertices, coarse.tetrahedra, 3)
    normals = Surface(coarse.vertices, faces).face_normals
    bent, _ = curve(space, faces, normals, Surface(fine.vertices, fine.boundary()[0]))
    np.testing.assert_allclose(bent.geometry, space.geometry, atol=1e-9)


def test_elements_that_would_fold_are_held_back() -> None:
    """A target that lies far inside a flat element: following it would turn the element inside out."""
    coarse = clean(*_wedge())
    faces, _, _ = coarse.boundary()
    dented = Surface(
        np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.5, 0.049], [0, 1, 0], [1, 1, 0.0]]),
        np.array([[0, 2, 1], [0, 3, 2], [3, 4, 2], [4, 1, 2]]),
    )
    space = Space.on(coarse.vertices, coarse.tetrahedra, 3)
    bent, report = curve(space, faces, Surface(coarse.vertices, faces).face_normals, dented)
    assert report["held_straight"] > 0
    assert volume(bent) > 0  # and raises if an element is folded


def test_a_short_edge_that_folds_its_element_leaves_the_long_ones_bent() -> None:
    """As at a rounded rim: the long edges beside it carry the curvature of the wall."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, 0.9, 0.1]])
    space = Space.on(corners, np.array([[0, 1, 2, 3]]), 2)
    geometry = space.geometry.copy()
    long, short = space.numbers[0, 4], space.numbers[0, 9]
    geometry[long], geometry[short] = (0, 0.05, 0), (0, -0.3, 0.3)
    unfolded, folds, intact = _unfold(space, geometry)
    assert folds.all()
    np.testing.assert_array_equal(unfolded[long], geometry[long])
    assert 0 < np.linalg.norm(unfolded[short]) < np.linalg.norm(geometry[short])
    assert intact[long]
    assert not intact[short]
    assert volume(space.shaped(unfolded)) > 0  # and raises if it is folded


def test_a_wildly_bent_body_has_no_folded_element(solid: Solid) -> None:
    """Straightening one element may fold its neighbour, and so on through the body."""
    space = Space.on(solid.vertices, solid.tetrahedra, 2)
    geometry = space.geometry.copy()
    bends = np.random.default_rng(0).normal(size=(space.size - space.vertex_count, 3))
    geometry[space.vertex_count :] = 2 * bends
    unfolded, _, intact = _unfold(space, geometry)
    np.testing.assert_array_equal(unfolded[intact], geometry[intact])
    shape = unfolded[space.numbers]
    slopes = differentiate(quadrature(11)[0], 2)
    edges = np.einsum("qik,tid->tqkd", slopes[:, :, 1:] - slopes[:, :, :1], shape)
    jacobian = np.linalg.det(edges) / np.linalg.det(shape[:, 1:4] - shape[:, :1])[:, None]
    assert np.all(jacobian.min(axis=1) >= least_jacobian(shape) - 1e-12)
    assert jacobian.min() >= LEAST_JACOBIAN


def test_order_one_cannot_be_bent(solid: Solid) -> None:
    faces, _, _ = solid.boundary()
    assert solid.target is not None
    with pytest.raises(ValueError, match="cannot be bent"):
        curve(Space.on(solid.vertices, solid.tetrahedra, 1), faces, np.zeros((len(faces), 3)), solid.target)


def _wedge() -> tuple[np.ndarray, np.ndarray, dict]:
    thin = box((1, 1, 1), (1, 1, 0.05))
    return thin.vertices, thin.tetrahedra, {}
