"""Samples written for other loaders: shards of WebDataset, or a folder that Hugging Face `datasets` reads."""

import io
import json
import tarfile
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.audio.synthesis.wav import wav_bytes
from objectfolder.dataset.order import batches_of_few_objects
from objectfolder.dataset.samples import ObjectSamples
from objectfolder.errors import InputError
from objectfolder.export.files import MANIFEST, Credit, new_folder, write_json
from objectfolder.extras import needs_extra

with needs_extra("dataset"):
    from PIL import Image

LAYOUTS = ("webdataset", "huggingface")
LOADER_SPLITS = {"training": "train", "held_out": "test"}  # the names that loaders know
BATCH, OBJECTS_TOGETHER = 64, 16
MOST_16_BIT = 65535
Files = dict[str, bytes]


def export_samples(
    root_or_files: Path | str | Sequence[Path | str],
    output: Path | str,
    sense: str = "vision",
    *,
    source: str = "truth",
    layout: str = "webdataset",
    shard_samples: int = 1000,
    seed: int = 0,
    overwrite: bool = False,
    **settings: Any,
) -> dict[str, int]:
    """Write the samples of one sense, both splits, in random order.

    Parameters
    ----------
    root_or_files, sense, source, settings
        As of `ObjectFolderDataset`.
    output
        A folder that appears whole or not at all.
    layout
        ``"webdataset"``: ``train-000000.tar`` and on, ``test-000000.tar`` and on. A sample is ``KEY.png`` or
        ``KEY.sound.npy`` (float32, m/s), ``KEY.depth_m.npy`` and ``KEY.mask.npy`` where it has them, and
        ``KEY.json`` with all else. ``"huggingface"``: folders ``train`` and ``test`` for the builders
        ``imagefolder`` and ``audiofolder``, each with ``metadata.jsonl``. Sounds are float WAV, m/s. Depth is
        16-bit PNG, metres when times ``depth_unit_m``, and 0 where the object is not.
    shard_samples
        Samples a shard of WebDataset.
    seed
        Of the order, and of the queries of files alone.
    overwrite
        Replace an earlier export.

    Returns
    -------
    dict
        Samples of ``train`` and ``test``.

    Raises
    ------
    InputError
        As of `ObjectFolderDataset`; an unknown layout; a folder that may not be written.

    Examples
    --------
    >>> export_samples(["bar.safetensors"], "touches", "touch", source="object_file", queries=3)
    {'train': 3, 'test': 3}
    """
    if layout not in LAYOUTS:
        raise InputError("layout", f"there is no {layout!r}", f"Choose of {', '.join(LAYOUTS)}.")
    if shard_samples < 1:
        raise InputError("shard_samples", f"{shard_samples}", "Give 1 or more.")
    counts: dict[str, int] = {}
    with new_folder(output, overwrite=overwrite) as folder:
        for split, name in LOADER_SPLITS.items():
            samples = ObjectSamples(root_or_files, sense, split, source, seed=seed, **settings)
            written = _written(samples, seed, in_folder=layout == "huggingface")
            if layout == "huggingface":
                counts[name] = _write_folder(folder / name, written)
            else:
                counts[name] = _write_shards(folder, name, written, shard_samples)
        credits = [Credit.of_record(name, samples.record(name)) for name in samples.object_ids]
        described = {"sense": sense, "source": source, "samples": counts}
        objects = [credit.to_dict() for credit in credits]
        write_json(folder / MANIFEST, {"format": layout, **described, "objects": objects})
        attribution = "\n".join(credit.to_text() for credit in credits)
        (folder / "ATTRIBUTION.txt").write_text(attribution, encoding="utf-8")
    return counts


def _written(
    samples: ObjectSamples, seed: int, *, in_folder: bool
) -> Iterator[tuple[str, Files, dict[str, Any]]]:
    """Yield the key of each sample, its files by what follows the key, and all else of it as JSON."""
    random = np.random.default_rng([seed, 0])
    for batch in batches_of_few_objects(samples.ranges(), BATCH, OBJECTS_TOGETHER, random):
        for sample in samples.__getitems__(batch):
            key = f"{sample['object_id']}-{sample['query']:06d}".replace(".", "_")  # a key ends at a dot
            files: Files = {}
            fields: dict[str, Any] = {}
            for name, value in sample.items():
                if name == "image":
                    files[".png"] = _png(np.round(value.transpose(1, 2, 0) * 255).astype(np.uint8))
                elif name == "sound" and in_folder:
                    files[".wav"] = wav_bytes(value, round(samples.settings.sample_rate_hz), gain=1.0)[0]
                elif name in ("sound", "depth_m", "mask") and not in_folder:
                    files[f".{name}.npy"] = _npy(value)
                elif name == "mask":
                    files["_mask.png"] = _png(value.astype(np.uint8) * 255)
                elif name == "depth_m":
                    files["_depth.png"], fields["depth_unit_m"] = _depth_png(value)
                else:
                    fields[name] = value if isinstance(value, str | int) else value.tolist()
            if samples.sense == "audio":
                fields["sample_rate_hz"] = samples.settings.sample_rate_hz
            yield key, files, fields


def _write_shards(
    folder: Path, split: str, written: Iterator[tuple[str, Files, dict[str, Any]]], size: int
) -> int:
    count = 0
    while part := list(islice(written, size)):
        with tarfile.open(
            folder / f"{split}-{count // size:06d}.tar", "w", format=tarfile.USTAR_FORMAT
        ) as shard:
            for key, files, fields in part:
                for ending, content in {**files, ".json": json.dumps(fields).encode()}.items():
                    entry = tarfile.TarInfo(key + ending)  # without time or owner: equal bytes
                    entry.size = len(content)
                    shard.addfile(entry, io.BytesIO(content))
        count += len(part)
    return count


def _write_folder(folder: Path, written: Iterator[tuple[str, Files, dict[str, Any]]]) -> int:
    columns = {".png": "file_name", ".wav": "file_name", "_mask.png": "mask_file_name"}
    columns["_depth.png"] = "depth_file_name"
    folder.mkdir()
    count = 0
    with (folder / "metadata.jsonl").open("w", encoding="utf-8") as lines:
        for key, files, fields in written:
            row = {columns[ending]: key + ending for ending in files}
            for ending, content in files.items():
                (folder / f"{key}{ending}").write_bytes(content)
            lines.write(json.dumps({**row, **fields}, allow_nan=False) + "\n")
            count += 1
    return count


def _png(image: np.ndarray) -> bytes:
    """Return (h, w) or (h, w, 3) of unsigned integers as PNG."""
    file = io.BytesIO()
    Image.fromarray(image).save(file, format="PNG")
    return file.getvalue()


def _npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()


def _depth_png(depth_m: np.ndarray) -> tuple[bytes, float]:
    """Return (h, w) depths as 16-bit PNG, 0 where they are infinite, and the metres of its unit."""
    finite = np.where(np.isfinite(depth_m), depth_m, 0.0)
    unit = float(finite.max()) / MOST_16_BIT or 1.0
    return _png(np.round(finite / unit).astype(np.uint16)), unit
