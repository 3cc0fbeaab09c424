"""Maps of a source, sampled on lattices of the stored faces."""

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from vision_shapes import cube

from objectfolder.making.visionnet import map_sampling
from objectfolder.making.visionnet.map_sampling import sample_maps, stored_mesh
from objectfolder.making.visionnet.texture_means import add_remainder, add_texture
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.network.face_lattice import FaceLattice


@pytest.mark.parametrize("cutoff", [None, 0.5])
def test_the_compiled_sums_are_those_of_the_texture_about_each_place(cutoff):
    random = np.random.default_rng(0)
    triangles = random.random((12, 3, 3))
    coordinates = random.uniform(-1.5, 2.5, (12, 3, 2))
    image = random.integers(0, 256, (7, 11, 3), dtype=np.uint8)
    lattice, steps = FaceLattice(triangles, 0.13), np.array([-0.25, 0.25])
    own = np.arange(12) % 3 > 0
    sums = np.zeros((int(lattice.counts.sum()), 3))
    add_texture(sums, image, coordinates, own, lattice, steps, cutoff)
    expected = np.zeros_like(sums)
    for offset in np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 2):
        face, barycentric = lattice.places(offset)
        values = bilinear(image, np.einsum("ij,ijk->ik", barycentric, coordinates[face]))
        expected += np.where(own[face][:, None], values if cutoff is None else values >= cutoff, 0)
    np.testing.assert_allclose(sums, expected, atol=1e-5)
    assert 0 < np.count_nonzero(sums) < sums.size


def test_what_a_lattice_lacks_is_added_to_the_values_about_it():
    random = np.random.default_rng(0)
    triangles = random.random((12, 3, 3))
    coordinates = random.uniform(-1.5, 2.5, (12, 3, 2))
    image = random.integers(0, 256, (7, 11, 3), dtype=np.uint8)
    lattice, steps = FaceLattice(triangles, 0.13), np.array([-0.25, 0.25])
    of_texture, values = np.arange(12) % 3 > 0, random.uniform(0, 255, (lattice.size, 3))
    remainder, weight = np.zeros_like(values), np.zeros(lattice.size)
    add_remainder(remainder, weight, values, image, coordinates, of_texture, lattice, steps)
    # A sample off its face is not counted: `places` takes it to the nearest of the face.
    on_face = 0
    shares, differences = np.zeros(lattice.size), np.zeros_like(values)
    place = np.arange(int(lattice.counts.sum()))
    _, columns, rows, start = lattice.grids
    for offset in np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 2):
        face, barycentric = lattice.places(offset)
        j, i = np.divmod(place - start[face], columns[face] + 1)
        x, y = (i + offset[0, 0]) / columns[face], (j + offset[0, 1]) / rows[face]
        inside = of_texture[face] & (x >= 0) & (y >= 0) & (x + y <= 1)
        face, barycentric = face[inside], barycentric[inside]
        texture = bilinear(image, np.einsum("ij,ijk->ik", barycentric, coordinates[face]))
        difference = 255 * texture - lattice.interpolate(values, face, barycentric)
        # The share that a value has of what is interpolated is the interpolation of it alone.
        for value in range(lattice.size):
            share = lattice.interpolate(np.eye(1, lattice.size, value).T, face, barycentric)
            shares[value] += share.sum()
            differences[value] += (share * difference).sum(axis=0)
        on_face += len(face)
    np.testing.assert_allclose(weight, shares, atol=1e-9)
    np.testing.assert_allclose(remainder, differences, atol=1e-3)
    assert 0 < on_face < 4 * len(place)


def test_a_fine_albedo_resolves_edges_and_colours_between_levels(monkeypatch):
    """Stripes that means blur, beside a grey that no level is."""
    monkeypatch.setattr(map_sampling, "ALBEDO_PITCHES", (1 / 64,))
    monkeypatch.setattr(map_sampling, "FINE_PITCHES", ())
    image = np.full((64, 64, 4), 255, dtype=np.uint8)
    image[:, :32, :3] = 115  # 28.4 of 63 levels
    image[:, 32:, :3] = 230 * (np.arange(32) // 5 % 2)[:, None]
    count = len(cube().faces)
    corners = np.tile(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), (count, 1, 1))
    mesh = replace(
        cube(), textures=(image,), texture_coordinates=corners, face_texture=np.zeros(count, dtype=np.int32)
    )
    stored = stored_mesh(mesh, decode_surface(encode_surface(mesh.surface)))
    frame, points = UnitFrame.of_points(stored.vertices), stored.surface.sample(20_000, seed=0)
    at = np.einsum("ij,ijk->ik", points.barycentric, stored.texture_coordinates[points.face])
    true = bilinear(image, at)[:, 0]

    def error(material: str) -> tuple[float, float]:
        maps = sample_maps(stored, frame, Appearance(), material)
        difference = maps.value("albedo", points.face, points.barycentric)[:, 0] - true
        even = (at[:, 0] % 1 > 0.1) & (at[:, 0] % 1 < 0.4)
        return float(np.sqrt((difference[~even] ** 2).mean())), float(abs(difference[even].mean()))

    (blurred, off), (sharp, even) = error("learned"), error("known")
    assert sharp < 0.9 * blurred
    assert even < 0.5 * off


def test_the_albedo_lies_on_the_finest_lattice_within_its_bytes_and_is_packed_once(monkeypatch):
    noise = np.random.default_rng(1).integers(0, 256, (64, 64, 4), dtype=np.uint8)
    noise[..., 3] = 255
    mesh = replace(cube(), textures=(noise,), face_texture=np.zeros(len(cube().faces), dtype=np.int32))
    stored = stored_mesh(mesh, decode_surface(encode_surface(mesh.surface)))
    frame = UnitFrame.of_points(stored.vertices)
    pitches = tuple(4 * pitch for pitch in map_sampling.ALBEDO_PITCHES[:4])  # coarse ones are packed sooner
    sizes = []
    for pitch in pitches:
        monkeypatch.setattr(map_sampling, "ALBEDO_PITCHES", (pitch,))
        sizes.append(len(sample_maps(stored, frame, Appearance()).tensors()["albedo"]))
    assert sizes == sorted(set(sizes))
    monkeypatch.setattr(map_sampling, "ALBEDO_PITCHES", pitches)
    for allowed, at in [(sizes[0] - 1, 0), *((size, index) for index, size in enumerate(sizes))]:
        monkeypatch.setitem(map_sampling.ALBEDO_BYTES, "learned", allowed)
        maps = sample_maps(stored, frame, Appearance())
        assert maps.pitches == {"albedo": pitches[at]}
        with mock.patch("objectfolder.vision.network.surface_maps.pack_levels", side_effect=AssertionError):
            stream = maps.tensors()["albedo"]
        assert len(stream) == sizes[at]
