"""Samples as other loaders read them: keys of WebDataset, and folders with `metadata.jsonl`."""

import io
import json
import tarfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from objectfolder.dataset import ObjectFolderDataset, export_samples
from objectfolder.errors import InputError
from pipeline.cli import main

SPLITS = {"train": "training", "test": "held_out"}


def of_shards(folder, split):
    """Return files by ending, of each key, in the order of shards; what WebDataset does."""
    files = {}
    for shard in sorted(folder.glob(f"{split}-*.tar")):
        with tarfile.open(shard) as archive:
            for entry in archive:
                key, _, ending = entry.name.partition(".")
                files.setdefault(key, {})[ending] = archive.extractfile(entry).read()
    return files


def pixels(image):
    return np.round(255 * image.numpy().transpose(1, 2, 0)).astype(np.uint8)


def samples_of(root, sense, split, **settings):
    samples = ObjectFolderDataset(root, sense, SPLITS[split], **settings)
    return {f"{sample['object_id']}-{sample['query']:06d}": sample for sample in samples}


@pytest.mark.parametrize("sense", ["vision", "audio", "touch"])
def test_shards_have_every_sample_as_it_is(small_set, tmp_path, sense):
    settings = {"duration_s": 0.1, "passes": True}
    counts = export_samples(small_set, tmp_path / "shards", sense, shard_samples=50, **settings)
    for split in SPLITS:
        expected, shard_files = (
            samples_of(small_set, sense, split, **settings),
            of_shards(tmp_path / "shards", split),
        )
        assert counts[split] == len(shard_files) == len(expected)
        assert len(list((tmp_path / "shards").glob(f"{split}-*.tar"))) == -(-len(shard_files) // 50)
        assert list(shard_files) != sorted(shard_files) or len(shard_files) < 5  # in random order
        assert shard_files.keys() == expected.keys()
        for key, files in shard_files.items():
            sample, said = expected[key], json.loads(files["json"])
            assert (said["object_id"], said["query"]) == (sample["object_id"], sample["query"])
            for name in ("sound", "depth_m", "mask"):
                assert (f"{name}.npy" in files) == (name in sample)
                if name in sample:
                    assert np.array_equal(np.load(io.BytesIO(files[f"{name}.npy"])), sample[name].numpy())
            if "image" in sample:
                assert np.array_equal(np.array(Image.open(io.BytesIO(files["png"]))), pixels(sample["image"]))
            for name in said.keys() & sample.keys() - {"object_id"}:
                assert np.array_equal(np.float32(said[name]), np.float32(sample[name])), name


def test_folders_have_a_row_for_every_picture(small_set, tmp_path):
    for sense in ("vision", "touch"):
        folder = tmp_path / sense
        export_samples(small_set, folder, sense, layout="huggingface", passes=True)
        for split in SPLITS:
            expected = samples_of(small_set, sense, split, passes=True)
            rows = [json.loads(line) for line in (folder / split / "metadata.jsonl").read_text().splitlines()]
            files = {row[key] for row in rows for key in row if key.endswith("file_name")}
            assert files == {path.name for path in (folder / split).iterdir()} - {"metadata.jsonl"}
            assert {Path(row["file_name"]).stem for row in rows} == expected.keys()
            for row in rows:
                sample = expected[Path(row["file_name"]).stem]
                image, depth, mask = (
                    np.array(Image.open(folder / split / row[name]))
                    for name in ("file_name", "depth_file_name", "mask_file_name")
                )
                assert np.array_equal(image, pixels(sample["image"]))
                assert np.array_equal(mask > 0, sample["mask"].numpy())
                assert depth.dtype == np.uint16
                depth_m = np.where(np.isfinite(sample["depth_m"]), sample["depth_m"], 0.0)
                assert np.abs(depth * row["depth_unit_m"] - depth_m).max() <= 0.51 * row["depth_unit_m"]


def test_sounds_of_folders_are_at_true_loudness(small_set, tmp_path):
    export_samples(small_set, tmp_path / "sounds", "audio", layout="huggingface", duration_s=0.1)
    expected = samples_of(small_set, "audio", "test", duration_s=0.1)
    for line in (tmp_path / "sounds/test/metadata.jsonl").read_text().splitlines():
        row = json.loads(line)
        content = (tmp_path / "sounds/test" / row["file_name"]).read_bytes()
        sound = expected[Path(row["file_name"]).stem]["sound"].numpy()
        assert np.array_equal(np.frombuffer(content[-sound.nbytes :], "<f4"), sound)
        assert row["sample_rate_hz"] == 44100


def test_equal_exports_have_equal_bytes_and_say_whose_objects_they_are(small_file, tmp_path):
    for name in ("one", "two"):
        export_samples([small_file], tmp_path / name, "touch", source="object_file", queries=3)
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()
    said = json.loads((tmp_path / "one/export.json").read_text())
    assert said["objects"][0]["object_id"] == small_file.stem
    assert f"({small_file.stem})" in (tmp_path / "one/ATTRIBUTION.txt").read_text()


def test_what_cannot_be_written_is_said(small_set, tmp_path):
    with pytest.raises(InputError, match="there is no 'zip'"):
        export_samples(small_set, tmp_path / "x", layout="zip")
    with pytest.raises(InputError, match="shard_samples: 0"):
        export_samples(small_set, tmp_path / "x", shard_samples=0)
    with pytest.raises(InputError, match="no objects with views"):
        export_samples(tmp_path, tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_the_command_writes_truth_or_files(small_set, small_file, tmp_path, capsys):
    root = ["--root", str(small_set), "--sense", "touch"]
    shards = ["export-samples", *root, "-o", str(tmp_path / "shards")]
    assert main(shards) == 0
    assert "6 samples to train and 12 to test" in capsys.readouterr().out
    assert main(shards) == 1
    assert "holds an export" in capsys.readouterr().err
    assert main([*shards, "--overwrite"]) == 0
    files = [
        "export-samples",
        str(small_file),
        "--sense",
        "audio",
        "--queries",
        "2",
        "--format",
        "huggingface",
    ]
    capsys.readouterr()
    assert main([*files, "--json", "-o", str(tmp_path / "files")]) == 0
    assert json.loads(capsys.readouterr().out) == {"folder": str(tmp_path / "files"), "train": 2, "test": 2}
    assert len(list((tmp_path / "files/train").glob("*.wav"))) == 2
