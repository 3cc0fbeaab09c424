"""Polygons of any shape become triangles that cover them once and keep the surface closed."""

from pathlib import Path

import numpy as np
import pytest
from hard_checks import Make, as_obj, check, refused
from hard_meshes import (
    BLUE,
    GREEN,
    L_OUTLINE,
    QUARTERS,
    RED,
    U_OUTLINE,
    WHITE,
    Truth,
    obj_text,
    outline_area,
    ply_bytes,
    prism,
    prism_truth,
    spiral_outline,
    star_outline,
    write_text,
)
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.making.mesh.readers.polygons import triangulated

# Polygons


def with_midpoints() -> tuple[np.ndarray, list[list[int]], Truth]:
    """A prism on an L whose straight sides have corners in the middle that the neighbours share."""
    following = np.roll(L_OUTLINE, -1, axis=0)
    outline = np.stack([L_OUTLINE, (L_OUTLINE + following) / 2], axis=1).reshape(-1, 2)
    vertices, polygons = prism(outline, 0.05)
    return vertices, polygons, prism_truth(outline, 0.05)


def square_tube() -> tuple[np.ndarray, list[list[int]], Truth]:
    """A tube whose ends are one polygon each: along the outline, in by a cut, around the hole and back."""
    outer = 0.1 * np.array([[0, 0], [3, 0], [3, 3], [0, 3]], dtype=np.float64)
    inner = 0.1 * np.array([[1, 1], [2, 1], [2, 2], [1, 2]], dtype=np.float64)
    vertices = np.array([[x, y, z] for z in (0.0, 0.2) for ring in (outer, inner) for x, y in ring])
    end = [0, 1, 2, 3, 0, 4, 7, 6, 5, 4]
    polygons = [end[::-1], [8 + corner for corner in end]]
    polygons += [[i, (i + 1) % 4, 8 + (i + 1) % 4, 8 + i] for i in range(4)]
    polygons += [[4 + i, 12 + i, 12 + (i + 1) % 4, 4 + (i + 1) % 4] for i in range(4)]
    truth = Truth(0.08 * 0.2, 2 * 0.08 + 0.2 * (1.2 + 0.4), (0.3, 0.3, 0.2))
    return vertices, polygons, truth


POLYGONS: dict[str, Make] = {
    "L": as_obj(*prism(L_OUTLINE, 0.05), prism_truth(L_OUTLINE, 0.05)),
    "U": as_obj(*prism(U_OUTLINE, 0.3), prism_truth(U_OUTLINE, 0.3)),
    "star": as_obj(*prism(star_outline(7), 0.02), prism_truth(star_outline(7), 0.02)),
    "star of many points": as_obj(*prism(star_outline(60, 0.9), 0.02),
                                  prism_truth(star_outline(60, 0.9), 0.02)),
    "spiral": as_obj(*prism(spiral_outline(), 0.03), prism_truth(spiral_outline(), 0.03)),
    "corners on straight sides": as_obj(*with_midpoints()),
    "hole by a cut": as_obj(*square_tube()),
    "dart": as_obj(*prism(0.1 * np.array([[0, 0], [2, -1], [0.5, 0], [2, 1.0]])[[1, 2, 3, 0]], 0.1),
                   prism_truth(0.1 * np.array([[0, 0], [2, -1], [0.5, 0], [2, 1.0]])[[1, 2, 3, 0]], 0.1)),
    "regular with many corners": as_obj(*prism(star_outline(90, 1.0), 0.1),
                                        prism_truth(star_outline(90, 1.0), 0.1)),
}  # fmt: skip


def test_polygons_of_any_shape(subtests, tmp_path):
    for name in POLYGONS:
        with subtests.test(name=name):
            check(*POLYGONS[name](tmp_path))


@pytest.mark.parametrize("name", ["L", "star", "corners on straight sides", "hole by a cut"])
def test_concave_polygons_of_ply(name, tmp_path):
    """The same solids as PLY: of text, and of both byte orders."""
    path, truth = POLYGONS[name](tmp_path)
    vertices, polygons = read_polygons(path)
    for order in ("", "<", ">"):
        check(write_text(tmp_path / "model.ply", ply_bytes(vertices, polygons, order)), truth)


def read_polygons(path: Path) -> tuple[np.ndarray, list[list[int]]]:
    lines = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([[float(value) for value in line[1:]] for line in lines if line[0] == "v"])
    polygons = [[int(word.split("/")[0]) - 1 for word in line[1:]] for line in lines if line[0] == "f"]
    return vertices, polygons


@st.composite
def outlines(draw: st.DrawFn) -> np.ndarray:
    """A polygon seen from the origin by all its corners, of 4 to 24 of them, in a random plane."""
    count = draw(st.integers(4, 24))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    angle = 2 * np.pi * (np.arange(count) + 0.8 * random.random(count)) / count
    flat = (0.05 + random.random(count))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    return flat @ axes[:2] + random.normal(size=3)


@given(outlines(), st.integers(0, 23))
def test_triangles_of_a_polygon_cover_it_once(points, first):
    points = np.roll(points, first, axis=0)
    corners, polygon = triangulated(points, [list(range(len(points)))])
    assert len(corners) == len(points) - 2
    assert (polygon == 0).all()
    normal = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    a, b, c = (points[corners[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a) @ normal / np.linalg.norm(normal)
    assert areas.min() > -1e-9
    assert areas.sum() == pytest.approx(np.linalg.norm(normal), rel=1e-9)
    # Each side of the polygon is a side of one triangle: what closes the surface around it.
    sides = {(int(t[i]), int(t[(i + 1) % 3])) for t in corners for i in range(3)}
    assert {(i, (i + 1) % len(points)) for i in range(len(points))} <= sides


def test_a_concave_polygon_of_too_many_corners_is_refused(tmp_path):
    outline = star_outline(2600)
    vertices = np.column_stack([outline, np.zeros(len(outline))])
    path = write_text(tmp_path / "model.obj", obj_text(vertices, [list(range(len(outline)))], material=""))
    refused(path, "concave face of 5200 corners", "Triangulate")


def test_the_area_of_an_outline_is_what_it_says():
    """The truth that polygons are held against, held against one that can be counted."""
    assert outline_area(L_OUTLINE) == pytest.approx(0.03)
    assert outline_area(U_OUTLINE) == pytest.approx(0.07)
    assert outline_area(spiral_outline()) > 0
    assert set(QUARTERS) == {RED, GREEN, BLUE, WHITE}
