"""ObjectFolder 1.0's AudioNet: from a position, a frequency and a time to a complex spectrogram.

Three perceptrons of (x, y, z, f, t), one for a unit force along each axis, give real and imaginary part of
one entry of the spectrogram: a sound is 51,657 evaluations of three networks and an inverse transform.
Published: the network, the transform, all inputs scaled to [0, 1], one range a branch for the outputs.
Published and not done here: the position of a query replaced by its four nearest vertices of the voxel grid,
and their four sounds added (a loss of accuracy apart from the network's, shown by `vertex_mean`, at four
times the cost of a query).

Training is not published. Decided here: batches of 1024 entries of the spectrograms of training points, half
of them drawn evenly and half by the mean power over the training points, weighted so that the loss is the
mean squared error over all entries (most entries are silent, and even draws would waste most of a batch); a
rate that falls to 5e-5; outputs that start at silence: from Xavier's rule, hundreds of steps end a hundred
times further from the truth than silence is.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from bench.rivals.published import Floats, Perceptrons, Training, UnitRange, fit, single

SAMPLE_RATE_HZ, SAMPLES = 16000.0, 32000
TRANSFORM, WINDOW, HOP = 512, 400, 160
BINS, FRAMES = TRANSFORM // 2 + 1, SAMPLES // HOP + 1
BATCH = 1024
FIRST_RATE, LAST_RATE = 5e-4, 5e-5
# Training points whose spectrograms give the range of the outputs, and the mean power.
RANGED_POINTS = 128


def spectrogram(sounds: ArrayLike) -> NDArray[np.complex128]:
    """Short-time Fourier transform (n, 257, 201) of sounds (n, 32000), 2 s at 16 kHz.

    Periodic Hann window of 400 samples in the middle of 512, hop 160, frames centred on multiples of the
    hop, silence before and after.
    """
    batch = torch.as_tensor(np.array(sounds, dtype=np.float64).reshape(-1, SAMPLES))
    return np.asarray(torch.stft(batch, **_transform(), pad_mode="constant", return_complex=True).numpy())


def inverse_spectrogram(transform: ArrayLike) -> Floats:
    """Sounds (n, 32000) whose spectrogram is nearest in squares to `transform` (n, 257, 201)."""
    batch = torch.as_tensor(np.array(transform, dtype=np.complex128).reshape(-1, BINS, FRAMES))
    return np.asarray(torch.istft(batch, **_transform(), length=SAMPLES).numpy())


def _transform() -> dict[str, Any]:
    window = torch.hann_window(WINDOW, dtype=torch.float64)
    return {"n_fft": TRANSFORM, "hop_length": HOP, "win_length": WINDOW, "window": window, "center": True}


@dataclass(frozen=True)
class SpectrogramNetwork:
    """A fitted network.

    Attributes
    ----------
    network : the three perceptrons
    position_range, output_range : scalings to [0, 1]; outputs have one a branch
    training : what the fit did
    """

    network: Perceptrons
    position_range: UnitRange
    output_range: UnitRange
    training: Training

    @property
    def bytes(self) -> int:
        """Stored: weights in single precision and the ranges."""
        return 4 * self.network.weights + 8 * (2 + 6)

    def spectrograms(self, points: ArrayLike) -> NDArray[np.complex128]:
        """Responses (n, 3, 257, 201) to unit impulses along the axes at points (n, 3) metres."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        entry = _entries(np.arange(BINS * FRAMES))
        result = np.empty((len(points), 3, BINS * FRAMES), dtype=np.complex128)
        for response, point in zip(result, self.position_range.to_unit(points), strict=True):
            inputs = np.concatenate([np.broadcast_to(point, (len(entry), 3)), entry], axis=1)
            values = self.output_range.from_unit(self.network.answers(inputs))
            response[:] = (values[..., 0] + 1j * values[..., 1]).T
        return result.reshape(len(points), 3, BINS, FRAMES)

    def sounds(self, points: ArrayLike, impulses: ArrayLike) -> Floats:
        """Sounds (n, 32000) at 16 kHz of impulses (n, 3) N s at points (n, 3) metres."""
        impulses = np.asarray(impulses, dtype=np.float64).reshape(-1, 3)
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        places, which = np.unique(points, axis=0, return_inverse=True)
        responses = self.spectrograms(places)[which.reshape(-1)]
        return inverse_spectrogram(np.einsum("nk,nkft->nft", impulses, responses))


def fit_spectrogram_network(
    points: ArrayLike, amplitudes: ArrayLike, mode_sounds: ArrayLike, *, steps: int, seed: int
) -> SpectrogramNetwork:
    """Fit to the spectrograms of the sounds at training points.

    Parameters
    ----------
    points
        (n, 3) metres.
    amplitudes
        (n, 3, modes): amplitude of each mode for a unit impulse along each axis.
    mode_sounds
        (modes, 32000): sound of each mode of amplitude 1, 2 s at 16 kHz. Sounds are linear in them, so that
        no spectrogram of a training point is stored.
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    amplitudes = np.asarray(amplitudes, dtype=np.float64)
    transforms = spectrogram(mode_sounds).reshape(amplitudes.shape[2], -1).astype(np.complex64)
    ranged = np.random.default_rng(seed).permutation(len(points))[:RANGED_POINTS]
    output_range, power = _range_and_power(amplitudes[ranged], transforms)
    position_range = UnitRange.of(points)
    places = position_range.to_unit(points)

    def loss(network: Perceptrons, generator: np.random.Generator) -> Tensor:
        point = generator.integers(len(points), size=BATCH)
        entry, weights = draw_entries(power, BATCH, generator)
        value = np.einsum("bkm,mb->bk", amplitudes[point], transforms[:, entry])
        targets = single(output_range.to_unit(np.stack([value.real, value.imag], axis=-1)))
        inputs = single(np.concatenate([places[point], _entries(entry)], axis=1))
        squares = (network(inputs) - targets).square().mean(dim=(1, 2))
        return (squares * single(weights)).mean()

    network, training = fit(
        lambda: Perceptrons(5, output_range.to_unit(np.zeros((1, 3, 2)))[0]),
        loss,
        lambda step: FIRST_RATE * (LAST_RATE / FIRST_RATE) ** (step / max(steps, 1)),
        steps=steps,
        seed=seed,
    )
    return SpectrogramNetwork(network, position_range, output_range, training)


def draw_entries(
    power: Floats, count: int, generator: np.random.Generator
) -> tuple[NDArray[np.int64], Floats]:
    """Draw entries (count,), half evenly and half in proportion to `power` (entries,), and their weights.

    Weighted means over the draws have the expectation of plain means over all entries.
    """
    even = generator.integers(power.size, size=count)
    edges = np.cumsum(power)
    if edges[-1] <= 0:
        return even, np.ones(count)
    loud = np.searchsorted(edges, generator.random(count) * edges[-1], side="right")
    entry = np.where(generator.random(count) < 0.5, even, np.minimum(loud, power.size - 1))
    return entry, 2 / (1 + power.size * power[entry] / edges[-1])


def _entries(index: NDArray[np.int64]) -> Floats:
    """Frequency and time (n, 2) in [0, 1] of entries of a flattened spectrogram."""
    return np.stack([index // FRAMES / (BINS - 1), index % FRAMES / (FRAMES - 1)], axis=1)


def _range_and_power(amplitudes: Floats, transforms: NDArray[np.complex64]) -> tuple[UnitRange, Floats]:
    """Range (1, 3, 1) of real and imaginary parts by branch, and mean power (entries,) over the points."""
    lowest, highest = np.full(3, np.inf), np.full(3, -np.inf)
    power = np.zeros(transforms.shape[1])
    for amplitude in amplitudes.astype(np.complex64):
        values = amplitude @ transforms
        power += np.sum(np.abs(values) ** 2, axis=0)
        for part in (values.real, values.imag):
            lowest, highest = np.minimum(lowest, part.min(axis=1)), np.maximum(highest, part.max(axis=1))
    return UnitRange.of(np.stack([lowest, highest])[:, :, None], axis=(0, 2)), power
