"""The canonical basis of repeated modes: against random rotations, signs, noise and other points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.making.modes.canonical import canonical_rotation, clusters


def on_sphere(count: int, seed: int) -> np.ndarray:
    x = np.random.default_rng(seed).normal(size=(count, 3))
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def lattice_on_sphere(count: int, turn: float = 0.0) -> np.ndarray:
    """Fibonacci's lattice: even, so that sums over it are integrals."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k + turn
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def torsion_of_ball(x: np.ndarray) -> np.ndarray:
    """The five torsional modes of degree 2: x cross the gradient of a quadratic harmonic, (p, 3, 5)."""
    forms = np.zeros((5, 3, 3))
    forms[0, 0, 1] = forms[0, 1, 0] = forms[1, 1, 2] = forms[1, 2, 1] = forms[2, 0, 2] = forms[2, 2, 0] = 1
    forms[3] = np.diag([1.0, -1.0, 0.0])
    forms[4] = np.diag([-1.0, -1.0, 2.0]) / np.sqrt(3)
    return np.stack([np.cross(x, 2 * x @ form) for form in forms], axis=2)


def ring_pairs(x: np.ndarray, orders: range) -> np.ndarray:
    """In-plane modes of a ring: for each order m the radial fields cos(m angle) and sin(m angle)."""
    angle = np.arctan2(x[:, 1], x[:, 0])
    radial = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    waves = [wave(m * angle) for m in orders for wave in (np.cos, np.sin)]
    return radial[:, :, None] * np.stack(waves, axis=1)[:, None, :]


def random_rotation(size: int, seed: int) -> np.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(size, size)))
    return q * np.sign(np.diag(r))


def mixed(eigenvalues: np.ndarray, shapes: np.ndarray, seed: int) -> np.ndarray:
    """What another seed of a solver may return: each cluster turned and reflected."""
    result = shapes.copy()
    for number, cluster in enumerate(clusters(eigenvalues)):
        size = cluster.stop - cluster.start
        result[:, :, cluster] = shapes[:, :, cluster] @ random_rotation(size, 1000 * seed + number)
    return result


def canonical_modes(eigenvalues: list | np.ndarray, shapes: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.asarray(shapes @ canonical_rotation(eigenvalues, shapes, points))


def relative(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def test_clusters_are_chains_of_near_neighbours() -> None:
    values = [1.0, 1.0 + 5e-5, 1.0 + 1e-4, 1.1, 2.0, 2.0]
    assert clusters(values) == [slice(0, 3), slice(3, 4), slice(4, 6)]
    assert clusters([]) == []
    assert clusters([3.0]) == [slice(0, 1)]


@given(seed=st.integers(0, 10_000))
def test_five_torsional_modes_of_a_ball_are_the_same_after_any_rotation(seed: int) -> None:
    x, values = on_sphere(800, 3), np.full(5, 2.0)
    shapes = torsion_of_ball(x)
    shapes /= np.sqrt(np.sum(shapes**2, axis=(0, 1)))
    turned = mixed(values, shapes, seed)
    first, second = (canonical_modes(values, u, x) for u in (shapes, turned))
    assert relative(second, first) < 1e-8
    rotation = canonical_rotation(values, turned, x)
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(5), atol=1e-12)


def test_pairs_of_a_ring_up_to_order_twenty_are_fixed_and_keep_under_noise() -> None:
    x = np.stack([np.cos(t := np.arange(2000) * 2 * np.pi / 2000), np.sin(t), 0.1 * np.cos(3 * t)], axis=1)
    shapes = ring_pairs(x, range(2, 21))
    values = np.repeat(np.arange(2, 21) ** 4.0, 2)
    first = canonical_modes(values, shapes, x)
    for seed in range(5):
        noise = 1e-7 * np.random.default_rng(seed).normal(size=shapes.shape)
        assert relative(canonical_modes(values, mixed(values, shapes, seed) + noise, x), first) < 1e-4


def test_other_points_of_the_body_give_nearly_the_same_modes() -> None:
    values = np.full(5, 2.0)
    answers = []
    for turn in (0.0, 1.0, 2.0):
        x = lattice_on_sphere(4000, turn)
        rotation = canonical_rotation(values, torsion_of_ball(x), x)
        answers.append(torsion_of_ball(on_sphere(300, 7)) @ rotation)
    assert relative(answers[1], answers[0]) < 1e-2
    assert relative(answers[2], answers[0]) < 1e-2


def test_size_and_place_of_the_body_do_not_matter() -> None:
    x, values = on_sphere(800, 3), np.full(5, 2.0)
    shapes = torsion_of_ball(x)
    rotation = canonical_rotation(values, shapes, x)
    np.testing.assert_allclose(canonical_rotation(1e6 * values, 1e-3 * shapes, 1e-3 * x), rotation, atol=1e-9)
    np.testing.assert_allclose(canonical_rotation(values, shapes, 40 * x + 7.0), rotation, atol=1e-9)


def test_single_modes_change_at_most_their_sign() -> None:
    x = on_sphere(500, 1)
    shapes = torsion_of_ball(x)
    values = np.arange(1.0, 6.0)
    rotation = canonical_rotation(values, shapes, x)
    np.testing.assert_array_equal(np.abs(rotation), np.eye(5))
    flipped = shapes * np.array([1, -1, 1, -1, -1])
    np.testing.assert_allclose(canonical_modes(values, flipped, x), canonical_modes(values, shapes, x))


def test_weights_stand_for_repeated_points() -> None:
    x, values = on_sphere(400, 2), np.full(5, 2.0)
    weights = 1.0 + np.arange(400) % 3
    many = np.repeat(np.arange(400), weights.astype(int))
    np.testing.assert_allclose(
        canonical_rotation(values, torsion_of_ball(x), x, weights),
        canonical_rotation(values, torsion_of_ball(x[many]), x[many]),
        atol=1e-9,
    )


def test_no_modes_and_wrong_shapes() -> None:
    x = on_sphere(10, 0)
    assert canonical_modes([], np.zeros((10, 3, 0)), x).shape == (10, 3, 0)
    with pytest.raises(ValueError, match="not those of 2"):
        canonical_rotation([1.0, 2.0], np.zeros((10, 3, 3)), x)
    with pytest.raises(ValueError, match="finite"):
        canonical_rotation([1.0], np.full((10, 3, 1), np.nan), x)
