"""Bodies of revolution: told from others, and filled with elements that repeat around the axis."""

import numpy as np
import pytest
import trimesh
from small_meshes import CUBE_FACES, CUBE_VERTICES
from walled_shapes import cap_volume, spherical_cap

from objectfolder.making.solid.filling import fill
from objectfolder.making.solid.normal_form import normal_form
from objectfolder.making.solid.revolution import Revolution, revolution_of
from objectfolder.making.solid.revolved import revolved_walls
from objectfolder.making.solid.solid import Solid, boundary_of, clean, volumes
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import enclosed_volume, is_closed

RADIUS, WALL = 0.06, 0.002
TURN = trimesh.transformations.rotation_matrix(1.0, [1, 2, 3])[:3, :3]


def tube(sections: int = 48) -> Surface:
    """A pipe as it is drawn: four rings, long triangles."""
    mesh = trimesh.creation.annulus(0.010, 0.012, 0.1, sections=sections)
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


def found(surface: Surface) -> Revolution | None:
    return revolution_of(normal_form(surface).surface)


@pytest.mark.parametrize("surface", [spherical_cap(RADIUS, WALL), tube()], ids=["bowl", "pipe"])
def test_a_turned_body_is_told_with_its_axis(surface: Surface) -> None:
    random = np.random.default_rng(0)
    noise = 1e-6 * RADIUS * random.standard_normal(surface.vertices.shape)
    form = normal_form(Surface((surface.vertices + noise) @ TURN.T + [1.0, 2.0, 3.0], surface.faces))
    body = revolution_of(form.surface)
    assert body is not None
    np.testing.assert_allclose(np.abs(body.frame[2] @ TURN[:, 2]), 1.0, rtol=1e-9)
    np.testing.assert_allclose(body.frame @ body.frame.T, np.eye(3), atol=1e-12)
    body_surface = body.surface(96)
    assert is_closed(body_surface)
    assert enclosed_volume(body_surface)[0] == pytest.approx(enclosed_volume(form.surface)[0], rel=5e-3)


def dented() -> Surface:
    surface = spherical_cap(RADIUS, WALL)
    vertices = surface.vertices.copy()
    vertices[(vertices[:, 0] > 0.04) & (np.abs(vertices[:, 1]) < 0.01), 0] -= 1e-4
    return Surface(vertices, surface.faces)


def oval() -> Surface:
    surface = spherical_cap(RADIUS, WALL)
    return Surface(surface.vertices * [1.0, 1.01, 1.0], surface.faces)


def octagon() -> Surface:
    mesh = trimesh.creation.annulus(0.010, 0.012, 0.1, sections=8)
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


@pytest.mark.parametrize("surface", [dented(), oval(), octagon(), Surface(CUBE_VERTICES, CUBE_FACES)])
def test_other_bodies_are_none(surface: Surface) -> None:
    assert found(surface) is None


def test_a_bulky_body_has_no_walls() -> None:
    mesh = trimesh.creation.cylinder(0.05, 0.1, sections=32)
    body = found(Surface(np.array(mesh.vertices), np.array(mesh.faces)))
    assert body is not None
    assert revolved_walls(body, lambda wall: np.full(len(wall), 0.1)) is None


@pytest.mark.parametrize("longest", [0.15, 0.08, 0.05])
def test_elements_fill_the_body_and_repeat_around_the_axis(longest: float) -> None:
    """Their boundary is closed and has their volume: none overlap, and faces meet whole."""
    body = found(spherical_cap(RADIUS, WALL))
    assert body is not None
    walls = revolved_walls(body, lambda wall: np.full(len(wall), longest))
    assert walls is not None
    vertices, tetrahedra, steps, sectors = walls
    solid = clean(vertices, tetrahedra, {})
    size = volumes(solid.vertices, solid.tetrahedra)
    boundary = Surface(solid.vertices, boundary_of(solid.tetrahedra)[0])
    assert solid.report["flat_elements_dropped"] == 0
    assert is_closed(boundary)
    assert enclosed_volume(boundary)[0] == pytest.approx(size.sum(), rel=1e-9)
    assert steps % 2 == 0  # half as many next to the axis
    assert sectors == _least_steps(solid, body)
    assert _turned_into_itself(solid, body, 2 * np.pi / sectors)


def _least_steps(solid: Solid, body: Revolution) -> int:
    """Vertices around the axis nearest to it."""
    local = (solid.vertices - body.centre) @ body.frame.T
    places = np.round(np.stack([np.hypot(local[:, 0], local[:, 1]), local[:, 2]], axis=1), 9)
    _, counts = np.unique(places[places[:, 0] > 0], axis=0, return_counts=True)
    return int(counts.min())


def _turned_into_itself(solid: Solid, body: Revolution, angle: float) -> bool:
    local = (solid.vertices - body.centre) @ body.frame.T
    cos, sin = np.cos(angle), np.sin(angle)
    turned = local @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    away = np.linalg.norm(turned[:, None] - local[None], axis=2)
    image = away.argmin(axis=1)
    same = {tuple(sorted(row)) for row in solid.tetrahedra.tolist()}
    return bool(
        away.min(axis=1).max() < 1e-9
        and same == {tuple(sorted(row)) for row in image[solid.tetrahedra].tolist()}
    )


def test_a_bowl_is_filled_by_turning() -> None:
    surface = spherical_cap(RADIUS, WALL)
    solid = fill(Surface(surface.vertices @ TURN.T + 0.1, surface.faces))
    assert (solid.report["way"], solid.report["doubts"]) == ("revolved", [])
    assert solid.components == 1
    assert solid.target is not None
    assert enclosed_volume(solid.target)[0] == pytest.approx(cap_volume(RADIUS, WALL), rel=2e-3)
