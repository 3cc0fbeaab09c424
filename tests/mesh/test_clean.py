"""The cleaning rule, orientation, and the measures of a solid against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_meshes import CUBE_FACES, CUBE_VERTICES, bare_mesh, cube, sorted_triangles, sphere

from objectfolder.errors import InputError
from objectfolder.making.mesh.cleaning import clean
from objectfolder.surface.integrals import solid_properties


def hollow_sphere(outer_m: float = 1.0, inner_m: float = 0.8, subdivisions: int = 3):
    vertices, faces = sphere(1.0, subdivisions)
    return (
        np.concatenate([outer_m * vertices, inner_m * vertices]),
        np.concatenate([faces, faces[:, ::-1] + len(vertices)]),
    )


def test_vertices_repeated_at_seams_are_welded():
    separate = bare_mesh(CUBE_VERTICES[CUBE_FACES].reshape(-1, 3), np.arange(36).reshape(12, 3))
    mesh, report = clean(separate)
    assert report.vertices_welded == 28
    assert mesh.surface.topology.watertight


def test_negative_zero_is_zero():
    vertices = CUBE_VERTICES[CUBE_FACES].reshape(-1, 3) + 0.5
    vertices[::2][vertices[::2] == 0] = -0.0
    mesh, _ = clean(bare_mesh(vertices, np.arange(36).reshape(12, 3)))
    assert len(mesh.vertices) == 8


def test_faces_folded_by_rounding_are_dropped_in_pairs():
    """Two distinct vertices that rounding put at one place: a collapsed face each side and a fold between."""
    # A cube whose vertex 7 is split into three that coincide; between them, slivers that fold.
    vertices = np.concatenate([CUBE_VERTICES, CUBE_VERTICES[[7, 3]]])
    fan = [face for face in CUBE_FACES.tolist() if not {3, 7} <= set(face)]
    faces = [*fan, [2, 7, 3], [1, 3, 7], [3, 7, 8], [3, 8, 7], [2, 9, 8], [2, 8, 9], [7, 8, 2]]
    mesh, report = clean(bare_mesh(vertices, np.array(faces)))
    assert report.degenerate_faces_dropped == 3
    assert report.folded_faces_dropped == 2
    topology = mesh.surface.topology
    assert topology.watertight
    assert topology.non_manifold_edges == 0
    assert len(mesh.faces) == 12


@pytest.mark.parametrize("second", [[0, 8, 1], [0, 1, 8]])
def test_a_pair_of_faces_that_encloses_nothing_goes_altogether(second):
    """A fin on an edge of a cube, wound either way."""
    vertices = np.concatenate([CUBE_VERTICES, [[0, -2, -2]]])
    mesh, report = clean(bare_mesh(vertices, np.concatenate([CUBE_FACES, [[0, 1, 8], second]])))
    assert report.folded_faces_dropped == 2
    assert report.vertices_unreferenced_dropped == 1
    np.testing.assert_array_equal(sorted_triangles(mesh), sorted_triangles(cube()))


@pytest.mark.parametrize("repeated", [[3], list(range(12)), [3, 3, 3]])
def test_a_face_of_the_surface_given_several_times_stays_once(repeated):
    mesh, report = clean(bare_mesh(CUBE_VERTICES, np.concatenate([CUBE_FACES, CUBE_FACES[repeated]])))
    assert report.repeated_faces_dropped == len(repeated)
    np.testing.assert_array_equal(sorted_triangles(mesh), sorted_triangles(cube()))


def test_texture_coordinates_move_with_reversed_corners():
    mesh = cube()
    coordinates = np.random.default_rng(0).random((12, 3, 2))
    inverted = bare_mesh(mesh.vertices, mesh.faces[:, ::-1])
    inverted = type(mesh)(
        inverted.vertices, inverted.faces, coordinates[:, ::-1], inverted.textures, inverted.face_texture
    )
    cleaned, report = clean(inverted)
    assert report.faces_reversed == 12
    np.testing.assert_array_equal(cleaned.faces, mesh.faces)
    np.testing.assert_array_equal(cleaned.texture_coordinates, coordinates)


@pytest.mark.parametrize("reversed_faces", [[4], [0, 1, 2], list(range(12)), list(range(7))])
def test_any_faces_of_a_cube_reversed_come_out_outward(reversed_faces):
    faces = CUBE_FACES.copy()
    faces[reversed_faces] = faces[reversed_faces, ::-1]
    mesh, report = clean(bare_mesh(CUBE_VERTICES, faces))
    np.testing.assert_array_equal(sorted_triangles(mesh), sorted_triangles(cube()))
    assert report.faces_reversed == len(reversed_faces)


@pytest.mark.parametrize("inverted", [False, True])
def test_cavity_of_a_hollow_sphere_stays_negative(inverted):
    vertices, faces = hollow_sphere()
    mesh, report = clean(bare_mesh(vertices, faces[:, ::-1] if inverted else faces))
    assert report.cavities == 1
    assert report.faces_reversed == (len(faces) if inverted else 0)
    properties = solid_properties(mesh.vertices, mesh.faces)
    full = solid_properties(*sphere(1.0)).volume_m3
    assert properties.volume_m3 == pytest.approx(full * (1 - 0.8**3), rel=1e-12)


def test_solid_in_a_cavity_and_solid_beside_are_solids():
    vertices, faces = hollow_sphere()
    ball, ball_faces = sphere(0.3)
    beside = ball + np.array([5, 0, 0])
    both = np.concatenate([vertices, ball, beside])
    parts = [faces, ball_faces + len(vertices), ball_faces[:, ::-1] + len(vertices) + len(ball)]
    _, report = clean(bare_mesh(both, np.concatenate(parts)))
    assert (report.cavities, report.nested_solids, report.faces_reversed) == (1, 1, len(ball_faces))


def test_open_surface_turned_inwards_is_turned_out_as_a_whole():
    mesh, report = clean(bare_mesh(CUBE_VERTICES, CUBE_FACES[2:, ::-1]))
    assert report.faces_reversed == 10
    topology = mesh.surface.topology
    assert (topology.watertight, topology.boundary_edges, topology.consistent) == (False, 4, True)


def test_moebius_strip_is_reported_and_left():
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    strip = [
        [(1 + side * np.cos(t / 2)) * np.cos(t), (1 + side * np.cos(t / 2)) * np.sin(t), side * np.sin(t / 2)]
        for t in turn
        for side in (-0.3, 0.3)
    ]
    faces = []
    for step in range(12):
        a, b = 2 * step, 2 * step + 1
        c, d = ((a + 2), (b + 2)) if step < 11 else (1, 0)
        faces += [[a, c, b], [b, c, d]]
    _, report = clean(bare_mesh(np.array(strip), np.array(faces)))
    assert report.unorientable_patches == 1


def test_nothing_left_is_an_error():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh = bare_mesh(vertices, np.array([[0, 1, 1], [0, 2, 0]]))
    with pytest.raises(InputError, match=r"sheet: no faces are left of 2: 2 collapse"):
        clean(mesh, "sheet")


@pytest.mark.parametrize("first", [0, 1])
def test_of_faces_doubled_back_to_back_one_layer_stays(first):
    """Every face a second time, wound the other way, in any order: the cube, and beside it the fold goes."""
    order = np.random.default_rng(first).permutation(24)
    both = np.concatenate([CUBE_FACES, CUBE_FACES[:, ::-1]])[order]
    mesh, report = clean(bare_mesh(CUBE_VERTICES, both))
    assert (report.doubled_faces_dropped, report.folded_faces_dropped) == (12, 0)
    np.testing.assert_array_equal(sorted_triangles(mesh), sorted_triangles(cube()))
    assert solid_properties(mesh.vertices, mesh.faces).volume_m3 == pytest.approx(1)

    vertices = np.concatenate([CUBE_VERTICES, CUBE_VERTICES + 3])
    fold = [[8, 9, 10], [8, 10, 9]]
    for beside, volume in (CUBE_FACES[:0], 1), (CUBE_FACES + 8, 2):
        mesh, report = clean(bare_mesh(vertices, np.concatenate([both, fold, beside])))
        assert (report.doubled_faces_dropped, report.folded_faces_dropped) == (12, 2)
        assert solid_properties(mesh.vertices, mesh.faces).volume_m3 == pytest.approx(volume)


def test_a_sheet_doubled_back_to_back_is_a_sheet():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh, report = clean(bare_mesh(vertices, np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]])))
    assert (len(mesh.faces), report.doubled_faces_dropped) == (2, 2)
    assert mesh.surface.topology.consistent


def dirty_mesh(seed: int):
    """A sphere with seams, repeated faces, collapsed faces and some faces reversed."""
    random = np.random.default_rng(seed)
    vertices, faces = sphere(1.0, 1)
    faces = np.concatenate([faces, faces[random.integers(0, len(faces), 3)], [[0, 0, 1]]])
    turned = random.random(len(faces)) < 0.2
    turned[-4:] = turned[-4:] & False
    turned[: len(faces) - 4] &= True
    faces[turned] = faces[turned, ::-1]
    separate = random.random(len(faces)) < 0.5
    split = np.where(separate[:, None], np.arange(3 * len(faces)).reshape(-1, 3) + len(vertices), faces)
    return bare_mesh(np.concatenate([vertices, vertices[faces].reshape(-1, 3)]), split)


@given(st.integers(0, 2**32 - 1))
def test_cleaning_a_clean_mesh_changes_nothing(seed):
    mesh, _ = clean(dirty_mesh(seed))
    again, report = clean(mesh)
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    np.testing.assert_array_equal(again.faces, mesh.faces)
    assert set(report.to_dict().values()) == {0}


@given(st.integers(0, 2**32 - 1))
def test_cleaning_does_not_depend_on_the_order_of_vertices(seed):
    mesh = dirty_mesh(seed)
    order = np.random.default_rng(seed + 1).permutation(len(mesh.vertices))
    permuted = bare_mesh(mesh.vertices[order], np.argsort(order)[mesh.faces])
    expected, expected_report = clean(mesh)
    result, report = clean(permuted)
    np.testing.assert_array_equal(sorted_triangles(result), sorted_triangles(expected))
    assert report == expected_report


def test_inertia_of_a_box():
    sides = np.array([0.1, 0.2, 0.4])
    vertices = CUBE_VERTICES * sides + [1.0, -2.0, 3.0]
    properties = solid_properties(vertices, CUBE_FACES)
    volume = sides.prod()
    expected = volume / 12 * (np.sum(sides**2) - sides**2)
    assert properties.volume_m3 == pytest.approx(volume, rel=1e-12)
    np.testing.assert_allclose(properties.centre_of_mass_m, [1, -2, 3], rtol=1e-12)
    np.testing.assert_allclose(properties.inertia_per_density_m5, np.diag(expected), rtol=1e-10, atol=1e-15)
