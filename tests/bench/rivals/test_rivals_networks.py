"""The published networks and the mean over nearest vertices: sizes, transform, and that they learn."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from bench.rivals.audio.gains_network import GainsNetwork, fit_gains_network
from bench.rivals.audio.spectrogram_network import (
    BINS,
    FRAMES,
    HOP,
    SAMPLE_RATE_HZ,
    SAMPLES,
    TRANSFORM,
    WINDOW,
    SpectrogramNetwork,
    draw_entries,
    fit_spectrogram_network,
    inverse_spectrogram,
    spectrogram,
)
from bench.rivals.audio.vertex_mean import nearest_vertex_mean
from bench.rivals.published import UNREAD_PARAMETERS, Perceptrons, UnitRange, encode, one_thread
from tests.drawn_examples import few_examples

pytestmark = pytest.mark.release("bench.rivals")


def perceptrons(dimensions: int, outputs: int) -> Perceptrons:
    """One perceptron for a unit force along each axis."""
    return Perceptrons(dimensions, np.zeros((3, outputs)))


def smooth_gains(points: np.ndarray) -> np.ndarray:
    """(n, 3, 4): slow waves over a box of half a metre, of the sizes that mode shapes have."""
    phase = points @ np.array([6.0, -4.0, 5.0])
    return 3 * np.sin(phase[:, None, None] + np.arange(12).reshape(3, 4))


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    return np.random.default_rng(0).random((600, 3)) * [0.5, 0.2, 0.1] - 0.1


@pytest.fixture(scope="module")
def gains_network(points: np.ndarray) -> GainsNetwork:
    return fit_gains_network(points[:500], smooth_gains(points[:500]), steps=100, seed=3)


@pytest.fixture(scope="module")
def mode_sounds() -> np.ndarray:
    time = np.arange(SAMPLES) / SAMPLE_RATE_HZ
    return np.stack([np.exp(-c * time) * np.sin(2 * np.pi * f * time) for f, c in ((700, 2), (2500, 6))])


@pytest.fixture(scope="module")
def spectrogram_network(points: np.ndarray, mode_sounds: np.ndarray) -> SpectrogramNetwork:
    amplitudes = smooth_gains(points[:500])[:, :, :2]
    return fit_spectrogram_network(points[:500], amplitudes, mode_sounds, steps=40, seed=3)


def test_sizes_are_the_published_ones() -> None:
    """6.3 MB an object for 1.0's sound, in units of 2^20 bytes, the unread layers included."""
    sound = perceptrons(5, 2).weights
    assert sound == 3 * 515_074
    assert round(4 * (sound + 3 * UNREAD_PARAMETERS) / 2**20, 1) == 6.3
    for modes in (34, 1965):  # the least and most of 2.0
        assert perceptrons(3, modes).weights == 3 * (493_056 + 257 * modes)


def test_coordinates_are_encoded_with_ten_octaves() -> None:
    encoded = encode(torch.tensor([[0.3, 0.7]], dtype=torch.float64)).numpy()[0]
    assert encoded.shape == (42,)
    np.testing.assert_allclose(encoded[:2], [0.3, 0.7])
    np.testing.assert_allclose(encoded[2:6], [*np.sin([0.3, 0.7]), *np.cos([0.3, 0.7])])
    np.testing.assert_allclose(encoded[-4:], [*np.sin([153.6, 358.4]), *np.cos([153.6, 358.4])])


def test_branches_are_apart_and_the_input_joins_at_the_sixth_layer() -> None:
    network = perceptrons(3, 5)
    for branch in network.branches:
        torch.nn.init.xavier_uniform_(branch.output.weight)
    assert [layer.in_features for layer in network.branches[0].hidden] == [63, *[256] * 4, 319, 256, 256]
    inputs = torch.rand(7, 3)
    before = network(inputs)
    with torch.no_grad():
        network.branches[1].output.bias += 1
        network.branches[2].hidden[5].weight[:, :63] += 1
    after = network(inputs)
    torch.testing.assert_close(after[:, 0], before[:, 0])
    torch.testing.assert_close(after[:, 1], before[:, 1] + 1)
    assert (after[:, 2] - before[:, 2]).abs().max() > 1e-3


def test_the_transform_agrees_with_another_implementation(mode_sounds: np.ndarray) -> None:
    ours = spectrogram(mode_sounds)
    assert ours.shape == (2, BINS, FRAMES) == (2, 257, 201)
    side = (TRANSFORM - WINDOW) // 2
    window = np.pad(signal.get_window("hann", WINDOW), side)
    _, _, theirs = signal.stft(
        mode_sounds,
        window=window,
        nperseg=TRANSFORM,
        noverlap=TRANSFORM - HOP,
        boundary="zeros",
        padded=False,
    )
    np.testing.assert_allclose(ours, theirs * window.sum(), atol=1e-9)


@given(st.integers(0, 2**31))
@few_examples(8)
def test_a_sound_comes_back_from_its_spectrogram(seed: int) -> None:
    sounds = np.random.default_rng(seed).standard_normal((2, SAMPLES))
    np.testing.assert_allclose(inverse_spectrogram(spectrogram(sounds)), sounds, atol=1e-10)


def test_gains_are_learned(points: np.ndarray, gains_network: GainsNetwork) -> None:
    losses = gains_network.training.losses
    assert losses[-10:].mean() < losses[:3].mean() / 5
    truth = smooth_gains(points[500:])
    error = gains_network.gains(points[500:]) - truth
    # The upper octaves of the coordinates let 500 points be met without the field between them.
    assert np.linalg.norm(error) < 0.6 * np.linalg.norm(truth)
    assert gains_network.network.weights == 3 * (493_056 + 257 * 4)
    assert gains_network.bytes == 4 * gains_network.network.weights + 8 * 20


def test_a_point_is_answered_alike_in_any_company(points: np.ndarray, gains_network: GainsNetwork) -> None:
    together = gains_network.gains(points)
    np.testing.assert_allclose(gains_network.gains(points[7]), together[7:8], rtol=1e-4, atol=1e-5)


def test_a_seed_gives_the_same_networks(points: np.ndarray, mode_sounds: np.ndarray) -> None:
    gains = smooth_gains(points)
    base, repeat, variant = (
        fit_gains_network(points, gains, steps=3, seed=seed).gains(points) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(base, repeat)
    assert np.abs(base - variant).max() > 1e-3
    first, again = (
        fit_spectrogram_network(points, gains[:, :, :2], mode_sounds, steps=2, seed=5).training.losses
        for _ in range(2)
    )
    np.testing.assert_array_equal(first, again)


def test_fitting_leaves_the_callers_threads_and_random_numbers_alone() -> None:
    torch.manual_seed(11)
    expected = torch.rand(3)
    torch.manual_seed(11)
    threads = torch.get_num_threads()
    with one_thread(5):
        torch.rand(4)
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == threads
    torch.testing.assert_close(torch.rand(3), expected)


def test_spectrograms_are_learned_in_the_units_of_the_sound(
    points: np.ndarray, mode_sounds: np.ndarray, spectrogram_network: SpectrogramNetwork
) -> None:
    losses = spectrogram_network.training.losses
    assert losses[-10:].mean() < losses[:3].mean() / 1.5
    assert spectrogram_network.network.weights == 3 * 515_074
    answer = spectrogram_network.spectrograms(points[500:501])
    truth = spectrogram(np.tensordot(smooth_gains(points[500:501])[0, :, :2], mode_sounds, 1))
    assert answer.shape == (1, 3, BINS, FRAMES)
    assert np.abs(answer).max() < 2 * np.abs(truth).max()
    # The range of the outputs is that of the training points' spectrograms, so it holds the truth's.
    low, extent = (
        spectrogram_network.output_range.lowest.ravel(),
        spectrogram_network.output_range.extent.ravel(),
    )
    assert np.all(truth.real.min(axis=(1, 2)) > low - 0.05 * extent)
    assert np.all(truth.real.max(axis=(1, 2)) < low + 1.05 * extent)


def test_sounds_are_linear_in_the_impulse(
    points: np.ndarray, spectrogram_network: SpectrogramNetwork
) -> None:
    first, second = np.array([1.0, 0, 0]), np.array([0, -2.0, 0.5])
    answers = spectrogram_network.sounds(
        np.repeat(points[:1], 4, axis=0), [first, second, first + second, 0 * first]
    )
    assert answers.shape == (4, SAMPLES)
    np.testing.assert_allclose(answers[2], answers[0] + answers[1], atol=1e-9 * np.abs(answers).max())
    np.testing.assert_array_equal(answers[3], 0)


def test_networks_start_at_the_mean_and_at_silence(points: np.ndarray, mode_sounds: np.ndarray) -> None:
    gains = smooth_gains(points)
    net = fit_gains_network(points, gains, steps=0, seed=0)
    np.testing.assert_allclose(net.gains(points[:2]), [gains.mean(axis=0)] * 2, atol=1e-5)
    silent = fit_spectrogram_network(points, gains[:, :, :2], mode_sounds, steps=0, seed=0)
    loudest = np.abs(silent.output_range.lowest).max()
    assert np.abs(silent.spectrograms(points[:1])).max() < 1e-6 * loudest


@pytest.mark.parametrize("loud", [True, False])
def test_draws_by_power_with_their_weights_stand_for_all_entries(loud: bool) -> None:
    generator = np.random.default_rng(0)
    power = np.exp(6 * generator.standard_normal(500)) * loud
    value = generator.random(500)
    entry, weights = draw_entries(power, 400_000, generator)
    assert np.mean(weights) == pytest.approx(1, abs=0.01)
    assert np.mean(weights * value[entry]) == pytest.approx(value.mean(), rel=0.01)
    assert weights.max() <= 2
    if loud:
        assert np.mean(entry == power.argmax()) > 0.3 * power.max() / power.sum()


def test_ranges_map_to_unit_and_back() -> None:
    values = np.random.default_rng(0).standard_normal((20, 3, 5)) * [[1], [10], [100]]
    scaling = UnitRange.of(values, axis=(0, 2))
    unit = scaling.to_unit(values)
    np.testing.assert_allclose(unit.min(axis=(0, 2)), 0, atol=1e-15)
    np.testing.assert_allclose(unit.max(axis=(0, 2)), 1)
    np.testing.assert_allclose(scaling.from_unit(unit), values, atol=1e-12)
    assert UnitRange.of(np.full(4, 7.0)).to_unit(np.full(4, 7.0)).tolist() == [0] * 4


@given(st.integers(0, 2**31), st.integers(4, 40))
def test_mean_over_nearest_vertices(seed: int, count: int) -> None:
    """Exact on constant fields, within the values met, and equal to a sort of all distances."""
    generator = np.random.default_rng(seed)
    nodes, points = generator.random((count, 3)), generator.random((5, 3))
    values = generator.standard_normal((count, 3, 2))
    np.testing.assert_array_equal(nearest_vertex_mean(nodes, np.full((count, 2), 3.5), points), 3.5)
    order = np.argsort(np.linalg.norm(points[:, None] - nodes, axis=2), axis=1)[:, :4]
    np.testing.assert_allclose(
        nearest_vertex_mean(nodes, values, points), values[order].mean(axis=1), atol=1e-14
    )


def test_the_mean_over_nearest_vertices_is_wrong_on_a_linear_field() -> None:
    """At a corner of a grid: four nearest are the corner and its neighbours, a quarter edge away in mean."""
    nodes = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    mean = nearest_vertex_mean(nodes, nodes, np.zeros((1, 3)))
    np.testing.assert_allclose(mean, [[0.25, 0.25, 0.25]])
