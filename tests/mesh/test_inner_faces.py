"""Partitions within a solid, stacks and seams: what is left is the outside, and closed."""

from itertools import pairwise

import numpy as np
import pytest
from small_meshes import bare_mesh, box

from objectfolder.making.mesh.cleaning import clean
from objectfolder.making.mesh.walls import measure_walls, wall_findings
from objectfolder.surface.integrals import solid_properties

LOW, HIGH = (0.0, 0.0, 0.0), (0.1, 0.08, 0.06)
VOLUME = 4.8e-4


def joined(*parts):
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    faces = [np.asarray(faces) + start for (_, faces), start in zip(parts, starts, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def floor(height, *, flipped=False, low=LOW, high=HIGH):
    """A rectangle across a box, its corners on the box's upright edges where it has the box's sides."""
    (x, y, _), (u, v, _) = low, high
    vertices = np.array([[x, y, height], [u, y, height], [u, v, height], [x, v, height]])
    return vertices, np.array([[0, 2, 1], [0, 3, 2]] if flipped else [[0, 1, 2], [0, 2, 3]])


def layer(low, high, *, turned=False):
    """A box from one height to another; turned, its diagonals are the other ones."""
    vertices, faces = box((*LOW[:2], low), (*HIGH[:2], high))
    if turned:
        pairs = faces.reshape(-1, 6)
        faces = pairs[:, [1, 2, 5, 1, 5, 0]].reshape(-1, 3)
    return vertices, faces


def layers(heights, **options):
    return [layer(low, high, **options) for low, high in pairwise(heights)]


def walls(heights):
    """Sides of a box between heights, its bottom and its top, and floors between."""
    parts = []
    for low, high in pairwise(heights):
        vertices, faces = layer(low, high)
        level = np.ptp(vertices[faces][..., 2], axis=1) == 0
        parts.append((vertices, faces[~level]))
    ends = [floor(heights[0], flipped=True), floor(heights[-1])]
    return [
        *parts,
        *ends,
        *(floor(height, flipped=index % 2 == 0) for index, height in enumerate(heights[1:-1])),
    ]


def jagged(noise):
    """Triangles of a box that share no vertex, each moved by noise."""
    vertices, faces = box(LOW, HIGH)
    corners = vertices[faces].reshape(-1, 3)
    return corners + np.random.default_rng(0).normal(0, noise, corners.shape), np.arange(36).reshape(-1, 3)


BOX = box(LOW, HIGH)
ACROSS = floor(0.03, low=(0.01, 0.01, 0), high=(0.09, 0.07, 0))
KINDS = {
    "a partition that shares its edges": (walls([0, 0.03, 0.06]), 2),
    "four partitions": (walls([0, 0.01, 0.02, 0.04, 0.05, 0.06]), 8),
    "boxes stacked, faces alike": (layers([0, 0.02, 0.04, 0.06]), 0),
    "boxes stacked, diagonals crossed": ([layer(0, 0.03), layer(0.03, 0.06, turned=True)], 4),
    "a sheet that shares no edge": ([BOX, ACROSS], 2),
    "a sheet of a wall's width": ([BOX, floor(0.03)], 2),
    "a lid with a crack of 2 micrometres": ([(BOX[0], BOX[1][BOX[0][BOX[1]][..., 2].min(axis=1) < 0.06]),
                                             floor(0.060002)], 0),
    "noise of 20 nanometres at every corner": ([jagged(2e-8)], 0),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_the_outside_is_what_is_solid(kind):
    parts, dropped = KINDS[kind]
    mesh, report = clean(bare_mesh(*joined(*parts)))
    topology = mesh.surface.topology
    assert (topology.watertight, topology.consistent, topology.components) == (True, True, 1)
    assert solid_properties(mesh.vertices, mesh.faces).volume_m3 == pytest.approx(VOLUME, rel=1e-5)
    assert report.inner_faces_dropped == dropped
    again, second = clean(mesh)
    np.testing.assert_array_equal(again.faces, mesh.faces)
    assert second.inner_faces_dropped == 0


def test_a_fin_a_hollow_and_an_opening_stay(subtests):
    """What has outside on one side at least is no partition."""
    inside = box((0.02, 0.02, 0.02), (0.04, 0.04, 0.04))
    fin = np.array([[0.1, 0, 0.06], [0.1, 0.08, 0.06], [0.15, 0.08, 0.06]]), np.array([[0, 1, 2]])
    vertices, faces = BOX
    kinds = {
        "fin": ([BOX, fin], 13),
        "hollow": ([BOX, (inside[0], inside[1][:, ::-1])], 24),
        "open": ([(vertices, faces[2:])], 10),
        "open, with a floor": ([*walls([0, 0.03, 0.06])[:3], floor(0.03)], 20),
    }
    for kind, (parts, count) in kinds.items():
        with subtests.test(kind=kind):
            mesh, report = clean(bare_mesh(*joined(*parts)))
            assert (report.inner_faces_dropped, len(mesh.faces)) == (0, count)


def test_solids_that_touch_at_a_corner_each_keep_their_outside():
    first, second = walls([0, 0.03, 0.06]), walls([0.06, 0.09, 0.12])
    moved = [(vertices + np.array([0.1, 0.08, 0]), faces) for vertices, faces in second]
    mesh, report = clean(bare_mesh(*joined(*first, *moved)))
    assert report.inner_faces_dropped == 4
    assert mesh.surface.topology.watertight
    assert solid_properties(mesh.vertices, mesh.faces).volume_m3 == pytest.approx(2 * VOLUME)


def test_a_crack_gets_no_advice_that_would_ruin_it():
    """A lid 200 micrometres above its box: closed but for cracks, while a box without a lid is open."""
    vertices, faces = BOX
    lid = vertices[faces][..., 2].min(axis=1) == 0.06
    cracked, _ = clean(bare_mesh(*joined((vertices, faces[~lid]), floor(0.0602))))
    measures = measure_walls(cracked.surface)
    assert (measures.closed, measures.cracked, measures.opening_share) == (False, True, 0.0)
    assert wall_findings(measures, material="wood") == ()
    measures = measure_walls(clean(bare_mesh(vertices, faces[~lid]))[0].surface)
    assert (measures.cracked, len(wall_findings(measures, material="wood"))) == (False, 1)
