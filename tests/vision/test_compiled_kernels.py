"""Parts of the compiled renderer alone: boxes, rasteriser, groups, and what its cache relies on."""

import numpy as np
import pytest
from compiled_cases import SHAPES
from numba import njit
from numba.core.caching import CacheImpl

from objectfolder.jit import kernel, relaxed_kernel
from objectfolder.surface.bounding_boxes import BoundingBoxTree
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.cameras import look_at, pixel_rays, sub_ray_offsets
from objectfolder.vision.compiled.bounding_volumes import HALVED_LEVEL, STACK, BoundingVolumes
from objectfolder.vision.compiled.grouping import GROUPS, choose_samples, samples_to_ask, split_groups
from objectfolder.vision.compiled.shading import TARGETS
from objectfolder.vision.compiled.visibility import Projection


def triangles_of(shape: str) -> np.ndarray:
    surface = SHAPES[shape]()
    return UnitFrame.of_points(surface.vertices).to_unit(surface.vertices)[surface.faces]


@pytest.mark.parametrize("shape", SHAPES)
def test_boxes_find_what_the_numpy_tree_finds(shape):
    triangles = triangles_of(shape)
    volumes, tree = BoundingVolumes.of_triangles(triangles), BoundingBoxTree(triangles)
    random = np.random.default_rng(1)
    origins, targets = random.normal(size=(2000, 3)), random.uniform(-0.5, 0.5, size=(2000, 3))
    face, barycentric = volumes.first_hits(origins, targets - origins)
    expected = tree.nearest_hits(origins, targets - origins)
    np.testing.assert_array_equal(face >= 0, expected >= 0)
    # Coincident faces aside, it is the same face.
    assert (face == expected).mean() > 0.998
    hit = face >= 0
    np.testing.assert_allclose(barycentric[hit].sum(axis=1), 1.0)
    light = np.array([0.7, 0.2, 0.6])
    selection = random.random(2000) < 0.8
    answer = volumes.occluded(targets, light, selection)
    np.testing.assert_array_equal(answer, selection & tree.occluded(targets, light - targets))


def test_every_face_is_in_one_leaf_and_boxes_hold_what_is_below_them():
    triangles = triangles_of("mug")
    volumes = BoundingVolumes.of_triangles(triangles)
    np.testing.assert_array_equal(np.sort(volumes.faces), np.arange(len(triangles)))

    def check(node: int) -> np.ndarray:
        parts = []
        for side in range(2):
            child, box = volumes.children[node, side], volumes.boxes[node, side]
            if child >= 0:
                faces = check(child)
            else:
                faces = volumes.faces[~child : ~child + volumes.counts[node, side]]
            assert (triangles[faces].reshape(-1, 3) > box[:3]).all()
            assert (triangles[faces].reshape(-1, 3) < box[3:]).all()
            parts.append(faces)
        return np.concatenate(parts)

    assert len(check(0)) == len(triangles)


def test_a_tree_over_shrinking_triangles_is_no_deeper_than_its_stack():
    scale = 0.5 ** np.arange(900)[:, None, None]
    triangles = scale * np.array([[0.9, 0, 0], [1.0, 0, 0], [0.9, 0.1, 0]])
    volumes = BoundingVolumes.of_triangles(triangles)
    level = np.zeros(len(volumes.children), dtype=int)
    for node, pair in enumerate(volumes.children):  # children stand behind their parents
        level[pair[volumes.counts[node] == 0]] = level[node] + 1
    assert HALVED_LEVEL < level.max() < STACK
    origins = triangles[[0, 5, 20]].mean(axis=1) + np.array([0.0, 0, 1])
    face, _ = volumes.first_hits(origins, np.tile([0.0, 0, -1], (3, 1)))
    assert face.tolist() == [0, 5, 20]


@pytest.mark.parametrize("shape", SHAPES)
def test_the_rasteriser_sees_what_rays_hit(shape):
    surface = SHAPES[shape]()
    vertices = UnitFrame.of_points(surface.vertices).to_unit(surface.vertices)
    pose, size, samples = look_at(np.array([[1.2, -1.7, 1.3]]))[0], (40, 48), 32
    at = Projection.of(vertices, surface.faces, pose, size, 39.6, (0, 0, *size), 0)
    slots = np.arange(at.height * at.width, dtype=np.int32).reshape(at.height, at.width)
    offsets = np.ascontiguousarray((sub_ray_offsets(samples) - 0.5).astype(np.float32).T)
    faces, nearness = at.sample(slots, slots.size, offsets)
    row, column = np.divmod(np.arange(slots.size), at.width)
    origins, directions = pixel_rays(
        pose, (row + at.top) * size[1] + column + at.left, sub_ray_offsets(samples), size, 39.6
    )
    tree = BoundingBoxTree(vertices[surface.faces])
    expected = tree.nearest_hits(np.ascontiguousarray(origins), directions).reshape(faces.shape)
    assert (expected >= 0).sum() > 1000
    assert ((faces >= 0) != (expected >= 0)).mean() < 2e-4
    assert (faces != expected).mean() < 2e-3
    assert (nearness[faces >= 0] > 0).all()
    everywhere = Projection.of(vertices, surface.faces, pose, size, 39.6, (0, 0, *size), 1000)
    assert (everywhere.height, everywhere.width) == (at.height, at.width)


def test_chosen_samples_are_members_of_their_groups_and_weigh_what_these_cover():
    random = np.random.default_rng(4)
    label = random.integers(-1, 3, size=(50, 16)).astype(np.int8)
    label[:10] = 0
    offsets = (sub_ray_offsets(16) - 0.5).astype(np.float32)
    counts = random.integers(0, 5, size=50)
    pixel, sample, group, weight = choose_samples(
        label, 2 * GROUPS, np.ascontiguousarray(offsets.T), counts, TARGETS
    )
    np.testing.assert_array_equal(label[pixel, sample], group)
    assert len(np.unique(np.stack([pixel, sample]), axis=1).T) == len(pixel)
    for p in range(50):
        for g in range(3):
            mine = (pixel == p) & (group == g)
            size = np.count_nonzero(label[p] == g)
            assert mine.sum() == min(counts[p], size)
            if counts[p] and size:
                assert weight[mine].sum() == pytest.approx(size / 16)


def test_a_shadow_splits_a_group_along_its_edge():
    offsets = (sub_ray_offsets(64) - 0.5).astype(np.float32)
    x, y = offsets[:, 0].copy(), offsets[:, 1].copy()
    label = np.zeros((2, 64), dtype=np.int8)
    label[1, :40] = -1
    pixel, sample = samples_to_ask(label, np.array([0, 1]), 16, GROUPS)
    assert np.count_nonzero(pixel == 0) == 16
    split_groups(label, pixel, sample, x[sample] > 0, x, y, GROUPS)
    assert set(np.unique(label[0])) == {0, GROUPS}
    assert ((label[0] == GROUPS) == (x > 0)).mean() > 0.85
    assert (label[1, :40] == -1).all()
    assert (label[1, 40:] == GROUPS).all()


def test_where_no_cache_can_be_written_kernels_are_compiled_all_the_same(monkeypatch):
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])

    def doubled(x):
        return 2 * x

    with pytest.raises(RuntimeError, match="no locator"):
        njit(doubled, cache=True)
    assert kernel(doubled)(4.0) == 8.0
    assert relaxed_kernel(doubled)(np.nan) != relaxed_kernel(doubled)(np.nan)
