"""What networks are shown: the answers of an Object File, by places and seeds."""

import numpy as np
import pytest
import torch

from learning.samples import SENSES, draw, regions_of, spectrograms, stored
from objectfolder import load
from objectfolder.dataset import ObjectFolderDataset
from objectfolder.errors import InputError


@pytest.fixture(scope="module")
def bar(small_file):
    return load(small_file)


@pytest.mark.parametrize("sense", SENSES)
def test_the_same_seed_draws_the_same_samples_and_another_others(bar, sense):
    first, again, second = (draw(bar, sense, 3, seed, 16) for seed in (0, 0, 1))
    assert torch.equal(first.inputs, again.inputs)
    assert not np.array_equal(first.places, second.places)
    assert first.inputs.dtype == (torch.float16 if sense == "touch" else torch.float32)
    assert min(first.inputs.shape[2:]) >= 16


@pytest.mark.parametrize("sense", SENSES)
def test_held_out_regions_share_no_place(bar, sense):
    trained, tested = regions_of(bar, sense, 5, seed=0)
    training = draw(bar, sense, 12, 1, 16, chosen=trained).places
    test = draw(bar, sense, 12, 1, 16, chosen=tested).places
    assert not tested(training).any()
    assert tested(test).all()
    together = draw(bar, sense, 12, 2, 16).places
    gaps = [np.linalg.norm(places[:, None] - training, axis=2).min(axis=1) for places in (test, together)]
    assert np.median(gaps[0]) > np.median(gaps[1])


def test_places_that_no_draw_has_are_an_error(bar):
    with pytest.raises(InputError, match=r"Glass bar: .*fewer than 3 places of vision"):
        draw(bar, "vision", 3, 0, 16, chosen=lambda places: np.zeros(len(places), dtype=bool))


def test_spectrograms_keep_loudness():
    wave = np.sin(2 * np.pi * 1000 * np.arange(22050) / 44100)[None].astype(np.float32)
    quiet, loud = spectrograms(wave, 32), spectrograms(100 * wave, 32)
    assert quiet.shape == (1, 1, 64, 64)
    at = int(quiet[0, 0].mean(dim=1).argmax())
    assert at == int(1000 / 22050 * 64)
    # A hundred times as loud is two decades, of the three that are 1.
    assert float((loud - quiet)[0, 0, at].median()) == pytest.approx(2 / 3, abs=1e-3)
    assert float(spectrograms(0 * wave, 32).abs().max()) == 0


def test_truth_and_object_file_answer_the_same_queries(small_file, tmp_path):
    for kind, name in (("views", "bar.zarr.zip"), ("object_files", "bar.safetensors")):
        (tmp_path / "data" / kind).mkdir(parents=True)
        source = small_file.parent / ("views.zarr.zip" if kind == "views" else small_file.name)
        (tmp_path / "data" / kind / name).symlink_to(source)
    truth, answer = (
        stored(ObjectFolderDataset(tmp_path, "vision", "training", source), 4, 7, [16])[0]
        for source in ("truth", "object_file")
    )
    matched = (truth - answer).square().mean(dim=(1, 2, 3))
    crossed = (truth - answer.roll(1, 0)).square().mean(dim=(1, 2, 3))
    assert (matched < crossed).all()
