"""The compressed surface is the surface, to half a grid step."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.errors import FormatError
from objectfolder.surface.codec import decode_surface, encode_surface, quantisation_step
from objectfolder.surface.surface import Surface


def _sorted_triangles(surface: Surface) -> np.ndarray:
    """Triangles up to their order and the rotation of their corners."""
    corners = surface.vertices[surface.faces]
    first = np.lexsort(corners.transpose(2, 0, 1)[::-1], axis=1)[:, 0]
    corners = np.take_along_axis(corners, ((first[:, None] + np.arange(3)) % 3)[..., None], axis=1)
    flat = corners.reshape(len(corners), 9)
    return flat[np.lexsort(flat.T[::-1])]


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.icosphere(3, 0.04),
        trimesh.creation.box((0.1, 0.05, 0.02)),
        trimesh.creation.torus(0.5, 0.1, 32, 16),
        trimesh.util.concatenate([trimesh.creation.box(), trimesh.creation.box(transform=np.eye(4) * 2)]),
    ],
    ids=["sphere", "box", "large torus", "two pieces"],
)
def test_vertices_move_by_at_most_half_a_step_and_faces_keep_their_sides(mesh: trimesh.Trimesh) -> None:
    surface = Surface(mesh.vertices, mesh.faces)
    step = quantisation_step(surface)
    snapped = surface.bounds[0] + np.rint((surface.vertices - surface.bounds[0]) / step) * step
    assert np.abs(snapped - surface.vertices).max() <= step / 2 * (1 + 1e-9)
    decoded = decode_surface(encode_surface(surface))
    np.testing.assert_allclose(
        _sorted_triangles(decoded), _sorted_triangles(Surface(snapped, mesh.faces)), atol=step * 1e-6
    )


def test_sixteen_thousand_triangles_take_less_than_50_kilobytes() -> None:
    mesh = trimesh.creation.icosphere(5, 0.05)
    random = np.random.default_rng(0)
    rough = mesh.vertices * (1 + 0.02 * random.random((len(mesh.vertices), 1)))
    tensors = encode_surface(Surface(rough, mesh.faces))
    assert sum(tensor.nbytes for tensor in tensors.values()) < 75_000 * len(mesh.faces) / 16384


@given(st.integers(0, 10_000), st.integers(1, 60))
@pytest.mark.slow
def test_any_soup_of_triangles_survives(seed: int, face_count: int) -> None:
    random = np.random.default_rng(seed)
    vertices = random.normal(size=(20, 3))
    faces = random.integers(0, 20, (face_count, 3))
    surface = Surface(vertices, faces)
    step = 1e-3
    decoded = decode_surface(encode_surface(surface, step))
    expected = Surface(surface.bounds[0] + np.rint((vertices - surface.bounds[0]) / step) * step, faces)
    assert len(decoded.faces) == face_count
    assert decoded.area == pytest.approx(expected.area, rel=1e-9)


def _turned_normals(surface: Surface, most_deg: float) -> np.ndarray:
    """Normals of the rule, leant over by up to an angle, another way at each corner."""
    across = np.cross(surface.corner_normals, np.random.default_rng(0).normal(size=(*surface.faces.shape, 3)))
    angle = np.radians(most_deg) * np.random.default_rng(1).random((*surface.faces.shape, 1))
    across /= np.linalg.norm(across, axis=2, keepdims=True)
    return np.cos(angle) * surface.corner_normals + np.sin(angle) * across


@pytest.mark.parametrize(
    "mesh", [trimesh.creation.icosphere(3, 0.04), trimesh.creation.box((0.1, 0.05, 0.02))]
)
def test_normals_of_the_source_come_back_within_a_degree(mesh: trimesh.Trimesh) -> None:
    walked = decode_surface(
        encode_surface(Surface(mesh.vertices, mesh.faces))
    )  # corners keep their order now
    normals = _turned_normals(walked, 50)
    normals[1] = 0  # the source has none there
    surface = Surface(walked.vertices, walked.faces, normals=normals)
    decoded = decode_surface(encode_surface(surface))
    np.testing.assert_array_equal(decoded.faces, surface.faces)
    cosine = np.einsum("fcx,fcx->fc", decoded.corner_normals, surface.corner_normals)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 1
    np.testing.assert_array_equal(
        decoded.corner_normals[1], decode_surface(encode_surface(walked)).corner_normals[1]
    )


def test_normals_that_the_rule_gives_take_no_bytes() -> None:
    mesh = trimesh.creation.icosphere(3, 0.04)
    bare = Surface(mesh.vertices, mesh.faces)
    named = Surface(mesh.vertices, mesh.faces, normals=bare.corner_normals)
    assert encode_surface(named).keys() == encode_surface(bare).keys()


@pytest.mark.parametrize("name", ["surface.normals", "surface.normal_ranks"])
def test_damaged_normals_are_an_error(name: str) -> None:
    mesh = trimesh.creation.icosphere(2, 0.04)
    bare = Surface(mesh.vertices, mesh.faces)
    tensors = encode_surface(Surface(mesh.vertices, mesh.faces, normals=_turned_normals(bare, 50)))
    for broken in (tensors[name][:-9], tensors[name][:1]):
        with pytest.raises(FormatError, match="surface: damaged"):
            decode_surface({**tensors, name: broken})


def test_encoding_is_idempotent_and_reproducible() -> None:
    mesh = trimesh.creation.icosphere(3, 0.04)
    once = encode_surface(Surface(mesh.vertices, mesh.faces))
    again = encode_surface(Surface(mesh.vertices, mesh.faces))
    assert all(np.array_equal(once[key], again[key]) for key in once)
    twice = decode_surface(encode_surface(decode_surface(once), float(once["surface.step"][0])))
    assert np.abs(twice.bounds - decode_surface(once).bounds).max() < 1e-12


@pytest.mark.parametrize("key", ["surface.connectivity", "surface.positions"])
def test_a_damaged_stream_is_refused(key: str) -> None:
    mesh = trimesh.creation.icosphere(2, 0.04)
    tensors = encode_surface(Surface(mesh.vertices, mesh.faces))
    tensors[key] = tensors[key][: len(tensors[key]) // 2]
    with pytest.raises(FormatError, match="damaged"):
        decode_surface(tensors)
