"""A stated wall overrides what a scan fused; thickness and volume against closed forms."""

import numpy as np
import pytest
from small_meshes import CUBE_FACES, CUBE_VERTICES
from walled_shapes import cap_volume, spherical_cap

from objectfolder.errors import InputError
from objectfolder.making.solid.local_thickness import local_thickness
from objectfolder.making.solid.thickening import thicken, unit_offsets
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import enclosed_volume, is_closed


def test_a_fused_bowl_gets_its_stated_wall() -> None:
    fused = spherical_cap(0.08, 0.001)
    bowl, share = thicken(fused, 0.0025)
    volume = enclosed_volume(bowl)[0]
    truth = spherical_cap(0.08, 0.0025)
    assert share > 0.97
    assert 2 * volume / bowl.area == pytest.approx(2 * enclosed_volume(truth)[0] / truth.area, rel=0.005)
    # The rim grows by as much as the faces: 1.5 mm of 209 mm of arc, on either side of the bowl.
    assert volume == pytest.approx(cap_volume(0.08, 0.0025, np.radians(75) + 0.00075 / 0.08), rel=0.01)
    assert np.median(local_thickness(bowl).across) == pytest.approx(0.0025, rel=0.02)


def test_the_middle_of_the_wall_stays() -> None:
    bowl, _ = thicken(spherical_cap(0.08, 0.001), 0.0025)
    distance = np.linalg.norm(bowl.vertices, axis=1)
    low = bowl.vertices[:, 2] < -0.04
    assert np.ptp(distance[low]) == pytest.approx(0.0025, rel=0.02)
    assert (distance[low].max() + distance[low].min()) / 2 == pytest.approx(0.08, rel=1e-3)


def test_a_plate_of_twelve_triangles_grows_on_all_sides() -> None:
    plate, _ = thicken(Surface(CUBE_VERTICES * [0.1, 0.08, 0.001], CUBE_FACES), 0.0025)
    np.testing.assert_allclose(np.ptp(plate.bounds, axis=0), [0.1015, 0.0815, 0.0025], rtol=1e-6)


def test_what_is_thick_enough_stays() -> None:
    block = Surface(CUBE_VERTICES * [0.1, 0.08, 0.06], CUBE_FACES)
    same, share = thicken(block, 0.003)
    assert share == 0
    np.testing.assert_array_equal(same.vertices, block.vertices)
    bowl = spherical_cap(0.08, 0.004)
    assert thicken(bowl, 0.003)[1] == 0


def test_a_thin_wall_on_a_block_grows_and_the_block_does_not() -> None:
    """A plate of 1 mm stands on a block of 30 mm."""
    plate = CUBE_VERTICES * [0.06, 0.001, 0.05] + [0, 0, 0.045]
    vertices = np.concatenate([CUBE_VERTICES * [0.06, 0.06, 0.03], plate])
    both, share = thicken(Surface(vertices, np.concatenate([CUBE_FACES, CUBE_FACES + 8])), 0.003)
    assert np.ptp(both.vertices[8:, 1]) == pytest.approx(0.003, rel=1e-3)
    np.testing.assert_allclose(np.ptp(both.vertices[:8], axis=0), [0.06, 0.06, 0.03], rtol=1e-3)
    assert 0.2 < share < 0.6


def test_gaps_never_close() -> None:
    """Two plates of 1 mm, 0.6 mm apart: each takes a third of the gap at most, and they stay two."""
    upper = CUBE_VERTICES * [0.1, 0.1, 0.001] + [0, 0, 0.0016]
    vertices = np.concatenate([CUBE_VERTICES * [0.1, 0.1, 0.001], upper])
    both, _ = thicken(Surface(vertices, np.concatenate([CUBE_FACES, CUBE_FACES + 8])), 0.004)
    gap = both.vertices[8:, 2].min() - both.vertices[:8, 2].max()
    assert gap == pytest.approx(0.0006 / 3, rel=1e-3)


def test_a_wall_is_a_positive_number(subtests: pytest.Subtests) -> None:
    for wall in [0.0, -0.001, float("nan"), float("inf")]:
        finding = r"bowl, wall_m: .* positive number of metres"
        with subtests.test(wall=wall), pytest.raises(InputError, match=finding):
            thicken(spherical_cap(0.08, 0.001), wall, "bowl")


def test_a_wall_thicker_than_the_object_is_refused() -> None:
    with pytest.raises(InputError, match=r"0\.05 m is no wall of an object with sides of 0\.15"):
        thicken(spherical_cap(0.08, 0.001), 0.05, "bowl")


def test_offsets_move_faces_by_one() -> None:
    np.testing.assert_allclose(
        unit_offsets(Surface(CUBE_VERTICES, CUBE_FACES)), 2 * CUBE_VERTICES, atol=1e-12
    )


def test_a_box_without_a_lid_is_a_box_of_sheets() -> None:
    """Its wall lies about the faces: the outside is one wall larger than the cavity's, up to the open end."""
    solid = Surface(CUBE_VERTICES * [0.1, 0.08, 0.06], CUBE_FACES)
    top = (solid.vertices[solid.faces][:, :, 2] > 0).all(axis=1)
    box, share = thicken(Surface(solid.vertices, solid.faces[~top]), 0.002)
    assert share == 1
    assert is_closed(box)
    outer, inner = 0.102 * 0.082 * 0.061, 0.098 * 0.078 * 0.059
    assert enclosed_volume(box)[0] == pytest.approx(outer - inner, rel=1e-9)


def test_an_open_tube_is_a_sheet_though_its_two_ends_face_away() -> None:
    angle = np.arange(64) * 2 * np.pi / 64
    ring = np.column_stack([0.03 * np.cos(angle), 0.03 * np.sin(angle), np.zeros(64)])
    corner, beside = np.arange(64), (np.arange(64) + 1) % 64
    faces = np.concatenate(
        [np.column_stack([corner, beside, corner + 64]), np.column_stack([beside, beside + 64, corner + 64])]
    )
    tube, _ = thicken(Surface(np.concatenate([ring, ring + np.array([0, 0, 0.1])]), faces), 0.001)
    ideal = np.pi * (0.0305**2 - 0.0295**2) * 0.1
    assert enclosed_volume(tube)[0] == pytest.approx(ideal, rel=0.005)


@pytest.mark.slow
def test_a_tee_of_three_sheets_has_the_volume_of_their_union() -> None:
    """Three faces meet at an edge: each sheet ends there, and what they share is inside once."""
    from objectfolder.making.solid.filling import fill

    vertices = np.array(
        [
            [0, 0, 0],
            [0, 0.1, 0],
            [0.1, 0, 0],
            [0.1, 0.1, 0],
            [-0.1, 0, 0],
            [-0.1, 0.1, 0],
            [0, 0, 0.1],
            [0, 0.1, 0.1],
        ]
    )
    faces = np.array([[0, 2, 1], [2, 3, 1], [4, 0, 1], [4, 1, 5], [0, 6, 7], [0, 7, 1]])
    solid = fill(Surface(vertices, faces), wall_m=0.004)
    # The upright sheet lies in the flat ones for half of the wall.
    assert solid.volume_m3 == pytest.approx(0.1 * 0.004 * (0.2 + 0.1 - 0.002), rel=0.01)
    assert solid.components == 1
