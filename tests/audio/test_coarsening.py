"""Collapsing edges, peeling and snapping change the mesh and not the solid."""

import numpy as np
import pytest
from structured_solids import ball, box

from objectfolder.solid.coarsening import BoundaryFit, coarsen
from objectfolder.solid.element_shape import heights_and_edges, shape
from objectfolder.solid.peeling import flat_on_boundary, peel
from objectfolder.solid.snapping import snap
from objectfolder.solid.solid import Solid, clean
from objectfolder.surface.edges import edge_table
from objectfolder.surface.surface import Surface


def coarser(solid: Solid, tolerance: float, longest_edge: float, thickness: float = np.inf) -> Solid:
    """The solid with collapsed edges, held to points of its own boundary."""
    faces, _, _ = solid.boundary()
    boundary = Surface(solid.vertices, faces)
    drawn = boundary.sample(2000, 0)
    fit = BoundaryFit(drawn.points, np.full(2000, tolerance), np.zeros(2000), faces[drawn.face])
    count = len(solid.vertices)
    tetrahedra = coarsen(
        solid.vertices,
        solid.tetrahedra,
        fit,
        np.full(count, tolerance),
        np.full(count, thickness),
        longest_edge,
    )
    return clean(solid.vertices, tetrahedra, {})


def euler_characteristic(solid: Solid) -> int:
    """Of the boundary: 2 for each ball, 0 for a ring."""
    faces, _, _ = solid.boundary()
    return len(np.unique(faces)) - len(edge_table(faces).vertices) + len(faces)


def ring() -> Solid:
    """A square plate with a square hole."""
    plate = box((6, 6, 1), (0.06, 0.06, 0.004))
    middle = plate.vertices[plate.tetrahedra].mean(axis=1)[:, :2]
    return clean(plate.vertices, plate.tetrahedra[(np.abs(middle - 0.03) > 0.01).any(axis=1)], {})


def test_a_box_stays_a_box_of_few_elements() -> None:
    block = box((6, 6, 6), (1, 1, 1))
    few = coarser(block, 1e-6, 2.0)
    assert len(few.tetrahedra) < len(block.tetrahedra) / 20
    assert few.volume_m3 == pytest.approx(1, abs=1e-9)
    assert euler_characteristic(few) == 2
    np.testing.assert_allclose(few.vertices[few.vertices.max(axis=1) == 1].max(axis=0), 1)


def test_a_plate_keeps_one_layer_through_its_wall() -> None:
    plate = box((12, 12, 2), (0.12, 0.12, 0.002))
    few = coarser(plate, 1e-6, 0.05, thickness=0.002)
    corner = few.vertices[few.tetrahedra]
    assert len(few.tetrahedra) < len(plate.tetrahedra) / 10
    assert few.volume_m3 == pytest.approx(0.12 * 0.12 * 0.002, rel=1e-9)
    np.testing.assert_allclose(np.ptp(corner[..., 2], axis=1), 0.002)
    assert heights_and_edges(corner)[1].max() <= 0.05


def test_a_hole_stays_a_hole() -> None:
    plate = ring()
    few = coarser(plate, 1e-6, 0.1, thickness=0.004)
    assert euler_characteristic(plate) == euler_characteristic(few) == 0
    assert few.volume_m3 == pytest.approx(plate.volume_m3, rel=1e-9)
    assert len(few.tetrahedra) < len(plate.tetrahedra)


def test_a_ball_keeps_to_its_tolerance_and_its_shape() -> None:
    whole = ball(6, 1.0)
    before = Surface(whole.vertices, whole.boundary()[0])
    for tolerance, least in ((0.01, 1.02), (0.05, 2.0)):
        few = coarser(whole, tolerance, 2.0)
        after = Surface(few.vertices, few.boundary()[0]).sampled_distance
        assert after.nearest(before.sample(500, 1).points)[1].max() < 1.5 * tolerance
        assert len(few.tetrahedra) * least < len(whole.tetrahedra)
        assert euler_characteristic(few) == 2
        worst, _ = shape(few.vertices[few.tetrahedra], np.full(len(few.tetrahedra), np.inf))
        first, _ = shape(whole.vertices[whole.tetrahedra], np.full(len(whole.tetrahedra), np.inf))
        assert worst.min() >= min(0.2, first.min())


def test_shape_of_known_elements() -> None:
    regular = np.array([[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1.0]])
    flat = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 0.1]])[[0, 2, 1, 3]]
    value, longest = shape(np.stack([regular, flat, flat[[1, 0, 2, 3]]]), np.array([np.inf, 0.1, 0.1]))
    # The least height of the flat one stands on its slanted face.
    slanted = 1 / np.sqrt(1 + 2 * 0.1**2)
    np.testing.assert_allclose(value, [2 * np.sqrt(2 / 3), slanted, -slanted])
    np.testing.assert_allclose(longest, [np.sqrt(8), np.sqrt(2), np.sqrt(2)])


def test_a_cap_is_peeled_off_and_a_corner_is_not() -> None:
    """A box with a flat tetrahedron on one of its faces."""
    block = box((1, 1, 1), (1, 1, 1))
    faces, _, _ = block.boundary()
    top = faces[(block.vertices[faces][:, :, 2] == 1).all(axis=1)][0]
    vertices = np.vstack([block.vertices, block.vertices[top].mean(axis=0) + np.array([0, 0, 0.01])])
    cap = np.append(top, len(block.vertices))[None]
    capped = clean(vertices, np.concatenate([block.tetrahedra, cap]), {})
    limits = np.full(len(vertices), 0.1)
    peeled = clean(capped.vertices, peel(capped.vertices, capped.tetrahedra, limits), {})
    assert len(peeled.tetrahedra) == len(block.tetrahedra)
    assert peeled.volume_m3 == pytest.approx(1)
    assert flat_on_boundary(capped.vertices, capped.tetrahedra) > flat_on_boundary(
        peeled.vertices, peeled.tetrahedra
    )
    assert len(peel(capped.vertices, capped.tetrahedra, 0 * limits)) == len(capped.tetrahedra)


def test_snapping_reaches_the_surface_on_its_own_side_of_a_wall() -> None:
    plate = box((6, 6, 1), (0.06, 0.06, 0.001))
    middle = np.abs(plate.vertices[:, :2] - 0.03).max(axis=1) < 0.025
    drawn_in = plate.vertices.copy()
    drawn_in[middle, 2] = 0.0005 + 0.1 * (drawn_in[middle, 2] - 0.0005)
    target = Surface(plate.vertices, plate.boundary()[0])
    thickness = np.full(len(drawn_in), 0.001)
    moved = snap(drawn_in, plate.tetrahedra, target, thickness, reach=1e-4)
    np.testing.assert_allclose(moved[middle, 2], plate.vertices[middle, 2], atol=1e-9)
    held = snap(drawn_in, plate.tetrahedra, target, 0 * thickness, reach=1e-6)
    np.testing.assert_array_equal(held[middle], drawn_in[middle])
