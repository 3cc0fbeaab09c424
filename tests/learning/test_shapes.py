"""Likeness of shapes against closed forms of spheres."""

import numpy as np
import pytest
import torch
import trimesh

from learning.isosurface import grid_points, surface_of
from learning.likeness import Likeness, likeness
from learning.occupancy import predicted
from learning.shapes import HALF_SIDE, inside, near_surface, overlap, volume_points


def sphere(radius: float, centre: tuple[float, float, float] = (0, 0, 0)) -> trimesh.Trimesh:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return ball.apply_translation(centre)


def compared(first: trimesh.Trimesh, second: trimesh.Trimesh, count: int) -> Likeness:
    points = volume_points(0)
    return likeness(first, second, overlap(inside(first, points), inside(second, points)), count, seed=0)


def test_concentric_spheres():
    comparison = compared(sphere(0.3), sphere(0.4), 20_000)
    assert comparison.iou == pytest.approx((0.3 / 0.4) ** 3, abs=0.01)
    assert comparison.chamfer == pytest.approx(0.1, abs=2e-3)
    assert comparison.normal_consistency > 0.99


def test_moved_sphere():
    moved = compared(sphere(0.2, (0.1, 0, 0)), sphere(0.2), 5000)
    half_way = 0.05
    both = 2 * np.pi / 3 * (0.2 - half_way) ** 2 * (2 * 0.2 + half_way)  # two caps
    assert moved.iou == pytest.approx(both / (2 * 4 / 3 * np.pi * 0.2**3 - both), abs=0.03)


def test_turned_inside_out_loses_nothing():
    ball = sphere(0.3)
    turned = trimesh.Trimesh(ball.vertices, ball.faces[:, ::-1])
    assert likeness(turned, ball, 1.0, 5000, 0).normal_consistency > 0.99


def test_nothing_predicted_is_the_worst_answer():
    worst = likeness(None, sphere(0.3), 0.0, 100, 0)
    assert (worst.iou, worst.normal_consistency) == (0, 0)
    assert worst.chamfer == pytest.approx(np.sqrt(3))


def test_the_surface_of_a_grid_bounds_its_volume():
    logits = 10 * (0.35 - np.linalg.norm(grid_points(64), axis=1))
    mesh = surface_of(logits.astype(np.float32), 64)
    assert mesh is not None
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.35**3, rel=0.02)
    assert surface_of(np.full(33**3, -1, np.float32), 32) is None
    full = surface_of(np.full(33**3, 1, np.float32), 32)
    assert full is not None
    assert full.volume == pytest.approx((2 * HALF_SIDE) ** 3, rel=0.15)


def test_the_surface_of_a_step_has_no_stairs():
    distances = np.linalg.norm(grid_points(64), axis=1)
    mesh = surface_of(np.where(distances < 0.35, 6, -6).astype(np.float32), 64)
    assert mesh is not None
    radii = np.linalg.norm(mesh.vertices, axis=1)
    cell = 2 * HALF_SIDE / 64
    assert np.abs(radii - 0.35).max() < cell / 2
    cosines = (mesh.face_normals * mesh.triangles_center).sum(axis=1) / radii[mesh.faces].mean(axis=1)
    assert cosines.mean() > 0.99  # .92 without smoothing


class Bowl(torch.nn.Module):
    """An occupancy network that knows one shape: half a shell, a fiftieth of its length thick."""

    asked = 0

    def forward(self, features, points):
        self.asked += len(points)
        wall = 0.01 - (points.norm(dim=1) - 0.4).abs()
        return 200 * torch.minimum(wall, -points[:, 2])[None]


def test_a_thin_wall_is_found_by_asking_few_points():
    bowl = Bowl()
    mesh = predicted(bowl, torch.zeros(1, 1), cells=128)[0]
    everywhere = grid_points(128)
    dense = surface_of(bowl(None, torch.from_numpy(everywhere))[0].numpy(), 128)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(dense.volume, rel=1e-3)
    assert mesh.volume == pytest.approx(2 / 3 * np.pi * (0.41**3 - 0.39**3), rel=0.05)
    assert bowl.asked - len(everywhere) < len(everywhere) / 5


def test_points_near_a_thin_sheet_find_its_inside():
    sheet = trimesh.creation.box((1, 1, 0.005))
    assert inside(sheet, volume_points(0, 4000)).mean() < 0.01
    assert inside(sheet, near_surface(sheet, 4000, 0)).mean() > 0.03
