"""WAV files against scipy's reader."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import wavfile

from objectfolder.audio.synthesis import write_wav
from objectfolder.audio.synthesis.sound import Sound
from objectfolder.errors import QueryError


@given(st.integers(1, 4), st.integers(0, 300), st.integers(1, 200_000), st.floats(-10, 10))
def test_what_is_written_is_read_with_its_true_values(
    tmp_path_factory: pytest.TempPathFactory, channels: int, samples: int, rate: int, gain: float
) -> None:
    path = tmp_path_factory.mktemp("wav") / "sound.wav"
    sound = 30 * np.random.default_rng(samples).normal(size=(channels, samples))
    write_wav(path, sound, sample_rate_hz=rate, gain=gain)
    if samples == 0:
        assert path.stat().st_size == 58
        return
    file_rate, content = wavfile.read(path)
    assert file_rate == rate
    assert content.dtype == np.float32
    np.testing.assert_array_equal(content.reshape(samples, channels), (sound.T * gain).astype(np.float32))


def test_one_channel_may_be_flat(tmp_path: Path) -> None:
    assert write_wav(tmp_path / "a.wav", [0.0, 2.5, -7.0], sample_rate_hz=8000, gain=1) == 1
    np.testing.assert_array_equal(wavfile.read(tmp_path / "a.wav")[1], np.float32([0.0, 2.5, -7.0]))


@pytest.mark.parametrize("peak", [1e-9, 0.3, 213.0])
def test_by_default_a_sound_peaks_three_decibels_below_full_scale(tmp_path: Path, peak: float) -> None:
    sound = peak * np.array([[0.5, -1.0], [0.25, 0.0]])
    gain = write_wav(tmp_path / "a.wav", sound, sample_rate_hz=8000)
    content = wavfile.read(tmp_path / "a.wav")[1]
    assert 20 * np.log10(np.abs(content).max()) == pytest.approx(-3, abs=1e-6)
    np.testing.assert_allclose(content.T, gain * sound, rtol=1e-6)


def test_a_sound_brings_its_own_rate(tmp_path: Path) -> None:
    write_wav(tmp_path / "a.wav", Sound.of(np.ones(4), 8000.0))
    write_wav(tmp_path / "b.wav", np.ones(4))
    assert [wavfile.read(tmp_path / name)[0] for name in ("a.wav", "b.wav")] == [8000, 44100]


def test_silence_stays_silence(tmp_path: Path) -> None:
    assert write_wav(tmp_path / "a.wav", np.zeros(8), sample_rate_hz=8000) == 1
    np.testing.assert_array_equal(wavfile.read(tmp_path / "a.wav")[1], np.zeros(8, np.float32))


def test_what_wav_cannot_hold_is_refused_and_leaves_nothing(
    subtests: pytest.Subtests, tmp_path: Path
) -> None:
    for sound, rate, gain in [
        ([np.nan], 8000, 1.0),
        ([1e39], 8000, 1.0),
        ([1.0], 8000, np.inf),
        ([1.0], 8000.5, 1.0),
        ([1.0], 0, 1.0),
        (np.zeros((2, 2, 2)), 8000, 1.0),
        (np.zeros((0, 2)), 8000, 1.0),
    ]:
        with subtests.test(sound=sound):
            with pytest.raises(QueryError):
                write_wav(tmp_path / "a.wav", sound, sample_rate_hz=rate, gain=gain)
            assert not list(tmp_path.iterdir())
