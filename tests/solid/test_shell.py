"""Closed containers made hollow, against hollow spheres and boxes."""

import numpy as np
import pytest
from small_meshes import CUBE_FACES, CUBE_VERTICES, sphere
from walled_shapes import spherical_cap

from objectfolder.errors import InputError
from objectfolder.making.solid.thickening import hollow
from objectfolder.surface.connectivity import edge_table
from objectfolder.surface.signed_distance import surface_at_depth
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import enclosed_volume

NODES = 50_000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shell", "nodes"),
    [(0.012, NODES), pytest.param(0.002, 200_000, marks=pytest.mark.release("objectfolder.making.solid"))],
)
def test_a_ball_becomes_a_hollow_sphere(shell: float, nodes: int) -> None:
    vertices, faces = sphere(0.05, 4)
    ball = Surface(vertices, faces)
    shelled = hollow(ball, shell, nodes=nodes)
    truth = 4 / 3 * np.pi * (0.05**3 - (0.05 - shell) ** 3)
    assert enclosed_volume(shelled)[0] == pytest.approx(truth, rel=0.01)
    assert (edge_table(shelled.faces).face_count == 2).all()
    np.testing.assert_array_equal(shelled.vertices[: len(vertices)], ball.vertices)
    inner = np.linalg.norm(shelled.vertices[len(vertices) :], axis=1)
    np.testing.assert_allclose(inner, 0.05 - shell, atol=0.0002)


def test_a_sharp_box_becomes_a_box_shell() -> None:
    sides = np.array([0.1, 0.08, 0.06])
    shelled = hollow(Surface(CUBE_VERTICES * sides + 7, CUBE_FACES), 0.003, nodes=NODES)
    assert enclosed_volume(shelled)[0] == pytest.approx(np.prod(sides) - np.prod(sides - 0.006), rel=0.01)


def test_what_is_thin_stays_solid() -> None:
    """A slab of 4 mm beside a box: the box alone is hollow with a shell of 3 mm."""
    box, slab = CUBE_VERTICES * 0.06, CUBE_VERTICES * [0.06, 0.06, 0.004] + [0.08, 0, 0]
    both = Surface(np.concatenate([box, slab]), np.concatenate([CUBE_FACES, CUBE_FACES + 8]))
    expected = 0.06**3 - 0.054**3 + 0.06 * 0.06 * 0.004
    assert enclosed_volume(hollow(both, 0.003, nodes=NODES))[0] == pytest.approx(expected, rel=0.02)


def test_a_scan_with_a_hole_is_hollowed_all_the_same() -> None:
    vertices, faces = sphere(0.05, 3)
    cavity = surface_at_depth(Surface(vertices, faces[8:]), 0.01, nodes=20_000)
    assert cavity is not None
    assert enclosed_volume(cavity)[0] == pytest.approx(4 / 3 * np.pi * 0.04**3, rel=0.05)


@pytest.mark.parametrize("shell", [0.03, 0.0301, 1.0])
def test_a_shell_thicker_than_the_object_is_refused(shell: float) -> None:
    with pytest.raises(InputError, match=r"can, shell_m: a shell of .* leaves nothing hollow"):
        hollow(Surface(CUBE_VERTICES * 0.06, CUBE_FACES), shell, "can")


def test_a_bowl_has_nothing_to_make_hollow() -> None:
    with pytest.raises(InputError, match="nowhere thick enough"):
        hollow(spherical_cap(0.08, 0.003), 0.004, nodes=NODES)


@pytest.mark.parametrize("shell", [0.0, -1.0, float("nan")])
def test_a_shell_is_a_positive_number(shell: float) -> None:
    with pytest.raises(InputError, match="positive number of metres"):
        hollow(Surface(CUBE_VERTICES, CUBE_FACES), shell)
