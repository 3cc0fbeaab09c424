"""Results that are kept by what they were made from, so that a run that was stopped goes on where it was."""

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from learning.settings import Settings
from objectfolder import load
from objectfolder.errors import InputError
from objectfolder.object_file import ObjectFile
from objectfolder.products.provenance import code_identity, fingerprint

RUNS = Path("learning/runs")
SHOWN_FIELDS = ("sense", "senses", "protocol", "object", "act", "seed")  # of a unit that was made
LOGS = RUNS / "logs"  # for TensorBoard
FEWEST = 4  # two to train on, two that are unseen


class ObjectFiles(Mapping[str, ObjectFile]):
    """Object Files by id, each opened where it is asked for and kept by whoever asked.

    An open file of a known material keeps 30 to 60 MB of what it decodes: a hundred would fill a memory.
    """

    def __init__(self, paths: Mapping[str, Path]) -> None:
        self._paths = paths

    def __getitem__(self, object_id: str) -> ObjectFile:
        return load(self._paths[object_id])

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)


class Objects:
    """The objects of a data set that sound.

    Parameters
    ----------
    settings
        Names the root and the ids.
    most
        Only the first ones by name.

    Raises
    ------
    InputError
        Fewer than `FEWEST` objects with an audible mode, or an id without a file.
    """

    def __init__(self, settings: Settings, most: int | None = None) -> None:
        self.root = Path(settings.data.root)
        folder = self.root / "data" / "object_files"
        paths = {path.stem: path for path in sorted(folder.glob("*.safetensors"))}
        for object_id in settings.data.objects:
            if object_id not in paths:
                raise InputError(str(folder), f"no object {object_id!r}", "Make it, or name others")
        names = settings.data.objects or paths
        sounding = (name for name in names if len(load(paths[name]).modes.frequencies_hz))
        self.ids = tuple(islice(sounding, most))
        if len(self.ids) < FEWEST:
            finding = f"{len(self.ids)} objects with a sound, fewer than {FEWEST}"
            raise InputError(str(folder), finding, "`make dataset` makes six")
        self.paths = {name: paths[name] for name in self.ids}
        self.files = ObjectFiles(self.paths)
        self.digests = {name: digest(path) for name, path in self.paths.items()}

        self._arguments = settings, most

    def __len__(self) -> int:
        return len(self.ids)

    def __reduce__(self) -> tuple[Any, ...]:
        # Workers read the data set themselves, once for all units.
        return opened, self._arguments


@cache
def opened(settings: Settings, most: int | None) -> Objects:
    """Return the objects of a data set, looked for once in this process."""
    return Objects(settings, most)


def digest(path: Path) -> str:
    """Return the SHA-256 of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@cache
def code_digest(module: str) -> str:
    """Return a digest of the code that a module reaches, in this package and in the library.

    Comments, docstrings and layout do not count.
    """
    return fingerprint(code_identity(module))[:16]


def kept_path(module: str, key: Mapping[str, Any], suffix: str) -> Path:
    """Return where a file is kept by what it depends on, as `kept`."""
    text = json.dumps([code_digest(module), key], sort_keys=True)
    return RUNS / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}{suffix}"


def kept(
    module: str, key: Mapping[str, Any], compute: Callable[[], dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Return arrays by what they depend on, from disk where they were made before.

    Parameters
    ----------
    module
        Dotted name of the module that computes them; with other code of it, or of what it imports, nothing
        that was kept is read.
    key
        What they depend on beside the code, as JSON has it; digests stand for files.
    """
    path = kept_path(module, key, ".npz")
    if path.exists():
        with np.load(path) as stored:
            return dict(stored)
    began, busy = time.perf_counter(), time.process_time()
    arrays = compute()
    facts = ", ".join(f"{name} {key[name]}" for name in SHOWN_FIELDS if name in key)
    seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - busy
    print(f"  {key['unit']}: {facts}, {seconds:.0f} s, {cpu_seconds:.0f} CPU-s", flush=True)
    RUNS.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f".{os.getpid()}.partial")
    with partial.open("wb") as file:
        np.savez(file, **arrays)
    partial.replace(path)
    return arrays
