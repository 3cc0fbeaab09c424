"""The occupancy network against closed forms of balls."""

import numpy as np
import pytest
import torch
import trimesh

from learning import occupancy
from learning.encoders import Encoded
from learning.occupancy import OVERLAP_WEIGHT, Shapes, fit, occupancy_loss, occupied_bits, predicted
from learning.reconstruction import object_probabilities
from learning.settings import read_settings
from learning.shapes import inside, near_surface, overlap, volume_points
from tests.learning.conftest import PARAMETERS

RADII = {0: 0.25, 2: 0.4, 3: 0.1}
FAR, NEAR = 20_000, 9000


SLOW_FIXTURES = ("trained",)


@pytest.fixture(scope="module")
def few_points():
    """Fewer points than the tasks take."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(occupancy, "FAR_POINTS", FAR)
        patch.setattr(occupancy, "NEAR_POINTS", NEAR)
        yield


@pytest.fixture(scope="module")
def balls(few_points):
    """Three balls; the object at position 1 is open."""
    meshes = {label: trimesh.creation.icosphere(3, radius) for label, radius in RADII.items()}
    about = [near_surface(mesh, NEAR // 3, label) for label, mesh in meshes.items()]
    points = np.concatenate([volume_points(0, FAR), *about])
    return Shapes(meshes, torch.from_numpy(points).float(), occupied_bits(list(meshes.values()), points))


@pytest.fixture(scope="module")
def trained(balls):
    """A network that knows the first two balls."""
    parameters = read_settings(PARAMETERS).reconstruction.model_copy(
        update={"steps": 100, "points": 512, "width": 16}
    )
    random = torch.Generator().manual_seed(0)
    labels = torch.arange(4).repeat_interleave(30)
    conditions = torch.eye(4)[labels] + 0.1 * torch.randn(len(labels), 4, generator=random)
    return fit(conditions, labels, balls, (0, 2), parameters, seed=0)


@pytest.mark.parametrize("label", [0, 2])
def test_conditions_say_how_large_a_ball_is(trained, label):
    (mesh,) = predicted(trained, torch.eye(4)[[label]], cells=32)
    points = volume_points(1)
    ball = np.linalg.norm(points, axis=1) < RADII[label]
    assert overlap(inside(mesh, points), ball) > 0.93


def test_bits_say_which_meshes_hold_a_point():
    radii = np.linspace(0.1, 0.5, 10)
    points = np.array([[radius, 0, 0] for radius in (0.05, 0.3, 0.52)])
    bits = occupied_bits([trimesh.creation.icosphere(3, radius) for radius in radii], points)
    expected = [[True] * 10, [False] * 5 + [True] * 5, [False] * 10]
    assert np.unpackbits(bits, axis=1, count=10).astype(bool).tolist() == expected


def test_leaving_a_thin_object_out_costs_its_overlap():
    occupied = torch.zeros(2, 1000)
    occupied[0, :500] = occupied[1, 0] = 1
    right = torch.where(occupied > 0, 20.0, -20.0)
    assert occupancy_loss(right, occupied) < 1e-6
    without = right.clone()
    without[1, 0] = -20
    by_points = 20 / 2000
    by_overlap = OVERLAP_WEIGHT * (1 - (1 + 1 / 2) / 2)
    assert occupancy_loss(without, occupied) == pytest.approx(by_points + by_overlap, rel=1e-4)


def test_points_about_surfaces_are_of_known_objects_alone(balls):
    rows = occupancy._near_rows([0, 2], len(balls.meshes))
    lengths = balls.points[rows].norm(dim=1)
    assert len(rows) == 2 * NEAR // 3
    assert not torch.any((lengths - RADII[2]).abs() < 0.05), "the ball between is not known"


def test_senses_that_are_unsure_say_together_what_both_think_likely():
    said = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5]], dtype=np.float32)
    nothing = np.empty((1, 2), np.float32)
    senses = [Encoded(nothing, np.log(row[None] + 1e-9), np.array([1]), nothing) for row in said]
    conditions, labels = object_probabilities(senses, seed=0)
    assert labels.tolist() == [1]
    torch.testing.assert_close(conditions, torch.tensor([[0.0, 1.0, 0.0]]), atol=1e-3, rtol=0)
    alone, _ = object_probabilities(senses[:1], seed=0)
    torch.testing.assert_close(alone**2, torch.from_numpy(said[:1]), atol=1e-3, rtol=0)
