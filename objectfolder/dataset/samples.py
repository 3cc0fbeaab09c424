"""Samples of data sets and of Object Files as NumPy arrays, query by query."""

import difflib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.audio.synthesis.oscillators import HIGHEST_RATIO
from objectfolder.dataset.reading import ProductReader, RecentValues
from objectfolder.dataset.senses import SENSE_READERS, Sample, Settings
from objectfolder.errors import FormatError, InputError
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.provenance import seed_from
from objectfolder.products.regular_file import read_regular
from objectfolder.products.splits import OBJECT_SPLITS, object_split
from objectfolder.products.tensor_file import read_metadata

SPLITS = ("training", "held_out")
SOURCES = ("truth", "object_file")
ARCHIVE, TENSOR_SUFFIX = ".zarr.zip", ".safetensors"


class ObjectSamples:
    """The samples of `ObjectFolderDataset` as NumPy arrays, which need no torch.

    Parameters, errors and keys of a sample are the same. Arrays are float32 unless they are whole or boolean.

    Examples
    --------
    >>> samples = ObjectSamples("bar.safetensors", "touch", source="object_file", queries=3)
    >>> len(samples), samples[0]["image"].shape
    (3, (3, 160, 120))
    """

    def __init__(
        self,
        root_or_files: Path | str | Sequence[Path | str],
        sense: str = "vision",
        split: str = "training",
        source: str = "truth",
        *,
        objects: Sequence[str] | None = None,
        object_split: str | None = None,
        queries: int = 64,
        seed: int = 0,
        duration_s: float = 1.0,
        sample_rate_hz: float = 44100.0,
        resolution: int = 128,
        sub_rays: int | None = None,
        passes: bool = False,
        all_queries: bool = False,
        open_objects: int = 16,
    ) -> None:
        for name, value, choices in (
            ("sense", sense, tuple(SENSE_READERS)),
            ("split", split, SPLITS),
            ("source", source, SOURCES),
        ):
            if value not in choices:
                raise InputError(name, f"there is no {value!r}", f"Choose of {', '.join(choices)}.")
        self.sense, self.split, self.source = sense, split, source
        self.settings = Settings(duration_s, sample_rate_hz, resolution, sub_rays, passes)
        self._open_objects = open_objects
        self._seed = seed
        self._root: Path | None = None
        self._files: dict[str, Path] = {}
        if isinstance(root_or_files, str | Path) and Path(root_or_files).is_dir():
            self._root = Path(root_or_files)
            self.object_ids = self._chosen(objects, object_split)
        else:
            paths = [root_or_files] if isinstance(root_or_files, str | Path) else list(root_or_files)
            self._take_files([Path(path) for path in paths], objects, object_split)
        self._open()
        if sense == "audio" and not all_queries:
            self._leave_out_silence()
        self._rows = [self._rows_of(object_id, queries, all_queries) for object_id in self.object_ids]
        self._ends = np.cumsum([len(rows) for rows in self._rows], dtype=np.int64)

    def _open(self) -> None:
        """Start with nothing open."""
        self._products: RecentValues[ProductReader] = RecentValues(self._product, self._open_objects)
        self._object_files: RecentValues[ObjectFile] = RecentValues(self._object_file, self._open_objects)
        self._queries: RecentValues[Sample] = RecentValues(self._query_table, self._open_objects)

    def __getstate__(self) -> dict[str, Any]:
        return {
            key: value
            for key, value in vars(self).items()
            if key not in ("_products", "_object_files", "_queries")
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._open()

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def __getitem__(self, index: int) -> dict[str, Any]:
        return self.__getitems__([index])[0]

    def __getitems__(self, indices: Sequence[int]) -> list[dict[str, Any]]:
        """Return samples, those of one object answered together; `DataLoader` asks so for a batch."""
        size = len(self)
        of_objects: dict[int, list[tuple[int, int]]] = {}
        for position, index in enumerate(indices):
            if not -size <= index < size:
                raise IndexError(f"sample {index} of {size}")
            place, number = self._place(int(index) % size)
            of_objects.setdefault(place, []).append((position, number))
        samples: list[dict[str, Any]] = [{}] * len(indices)
        for place, requests in of_objects.items():
            answers = self._answers(place, np.array([number for _, number in requests]))
            for (position, _), sample in zip(requests, answers, strict=True):
                samples[position] = sample
        return samples

    def _answers(self, place: int, numbers: np.ndarray) -> Iterator[dict[str, Any]]:
        """Yield samples of one object."""
        object_id, rows = self.object_ids[place], self._rows[place][numbers]
        query = {key: values[numbers] for key, values in self._queries[place].items()}
        sense = SENSE_READERS[self.sense]
        if self.source == "truth":
            samples = sense.truth(self._products[object_id], rows, query, self.settings)
        else:
            reader = self._products[object_id] if self._root else None
            samples = sense.answer(self._object_files[object_id], query, self.settings, reader)
        arrays = {key: _single(value) for key, value in {**samples, **query}.items()}
        for position, row in enumerate(rows.tolist()):
            parts = {key: values[position, ...] for key, values in arrays.items()}
            yield {**parts, "object_id": object_id, "query": row}

    def place(self, index: int) -> tuple[str, int]:
        """Return object id and query of a sample, without reading it; `index` from 0."""
        place, number = self._place(index)
        return self.object_ids[place], int(self._rows[place][number])

    def ranges(self) -> list[tuple[int, int]]:
        """Return the first index of each object's samples, and the index behind the last."""
        ends = self._ends.tolist()
        return list(zip([0, *ends[:-1]], ends, strict=True))

    def _place(self, index: int) -> tuple[int, int]:
        place = int(np.searchsorted(self._ends, index, side="right"))
        return place, index - (int(self._ends[place - 1]) if place else 0)

    def _chosen(self, objects: Sequence[str] | None, part: str | None) -> list[str]:
        assert self._root is not None
        folder = self._root / "data" / SENSE_READERS[self.sense].kind
        ids = _ids(folder, ARCHIVE)
        if self.source == "object_file":
            ids &= _ids(self._root / "data" / "object_files", TENSOR_SUFFIX)
        if not ids:
            raise InputError(
                str(self._root),
                f"no objects with {folder.name}{' and an Object File' if self.source != 'truth' else ''}",
                "Name the root of a data set; `dvc pull` or `objectfolder get --stage` brings its products.",
            )
        return self._of_split(_checked(objects, ids, str(folder)), part)

    def _of_split(self, ids: list[str], part: str | None) -> list[str]:
        if part is None:
            return ids
        assert self._root is not None
        if part not in OBJECT_SPLITS:
            raise InputError(
                "object_split", f"there is no {part!r}", f"Choose of {', '.join(OBJECT_SPLITS)}."
            )
        path = self._root / "data" / "records.json"
        try:
            rows = json.loads(read_regular(path))["objects"]
            materials = {object_id: str(rows[object_id]["material"]["name"]) for object_id in ids}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                str(path),
                f"no materials of the objects in it ({error})",
                "Copy it from the data set's repository: `objectfolder get` brings products alone.",
            ) from error
        return [object_id for object_id in ids if object_split(object_id, materials[object_id]) == part]

    def _take_files(self, paths: list[Path], objects: Sequence[str] | None, part: str | None) -> None:
        if self.source == "truth":
            where = ", ".join(map(str, paths[:3]))
            raise InputError(where, "Object Files have no truth with them", 'Choose source="object_file".')
        if part is not None:
            raise InputError("object_split", "needs the root of a data set", "Choose files yourself.")
        for path in paths:
            if not path.is_file():
                raise FileNotFoundError(2, "no such file", str(path))
            self._files[path.name.removesuffix(TENSOR_SUFFIX)] = path
        if len(self._files) < len(paths):
            raise InputError(str(paths[0].parent), "two files of one name", "Choose one of them.")
        self.object_ids = _checked(objects, set(self._files), "the files")

    def _product(self, object_id: str) -> ProductReader:
        assert self._root is not None
        return ProductReader(self._root / "data" / SENSE_READERS[self.sense].kind / f"{object_id}{ARCHIVE}")

    def record(self, object_id: str) -> dict[str, Any] | None:
        """Return name, source, licence and attribution of an object as its file or record has them."""
        path = self._object_path(object_id)
        if path.is_file():
            description: dict[str, Any] | None = json.loads(read_metadata(path).get("object", "null"))
            return description
        assert self._root is not None
        records = self._root / "data" / "records.json"
        content = json.loads(records.read_text(encoding="utf-8")) if records.is_file() else {"objects": {}}
        entry: dict[str, Any] | None = content["objects"].get(object_id)
        return entry

    def _object_path(self, object_id: str) -> Path:
        if self._root is None:
            return self._files[object_id]
        return self._root / "data" / "object_files" / f"{object_id}{TENSOR_SUFFIX}"

    def _object_file(self, object_id: str) -> ObjectFile:
        return ObjectFile.load(self._object_path(object_id))

    def _leave_out_silence(self) -> None:
        highest = HIGHEST_RATIO * self.settings.sample_rate_hz
        sounding = [name for name in self.object_ids if (self._frequencies_hz(name) <= highest).any()]
        if self.object_ids and not sounding:
            raise InputError(
                ", ".join(self.object_ids[:3]),
                f"no mode up to {highest:.0f} Hz: all sounds are silence",
                "Name other objects, or ask for all_queries=True.",
            )
        self.object_ids = sounding

    def _frequencies_hz(self, object_id: str) -> np.ndarray:
        if self._root is not None:
            return self._product(object_id).whole("frequencies_hz")
        path = self._files[object_id]
        try:
            return np.array(json.loads(read_metadata(path)["modes"])["frequencies_hz"], dtype=np.float64)
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError(str(path), f"not an Object File ({error})", "Build one from a mesh.") from error

    def _rows_of(self, object_id: str, queries: int, all_queries: bool) -> np.ndarray:
        if self._root is None:
            return np.arange(queries)
        reader = self._product(object_id)
        chosen = reader.whole("held_out") == (self.split == "held_out")
        if self.sense == "touch" and not all_queries:
            chosen &= reader.whole("reachable")
        return np.flatnonzero(chosen)

    def _query_table(self, place: int) -> Sample:
        object_id, rows = self.object_ids[place], self._rows[place]
        if self._root is not None:
            return SENSE_READERS[self.sense].queries(self._products[object_id], rows)
        seed = seed_from(self._seed, f"{self.sense} {self.split}", object_id)
        return SENSE_READERS[self.sense].sampled(self._object_files[object_id], len(rows), seed)


def _ids(folder: Path, suffix: str) -> set[str]:
    if not folder.is_dir():
        return set()
    return {
        path.name.removesuffix(suffix)
        for path in folder.iterdir()
        if path.name.endswith(suffix) and not path.name.startswith(".")
    }


def _checked(objects: Sequence[str] | None, ids: set[str], where: str) -> list[str]:
    if objects is None:
        return sorted(ids)
    for object_id in objects:
        if object_id not in ids:
            near = difflib.get_close_matches(object_id, ids, n=3, cutoff=0.4) or sorted(ids)[:5]
            raise InputError(where, f"no object {object_id!r}", f"There are {', '.join(near)}.")
    return list(objects)


def _single(value: np.ndarray) -> np.ndarray:
    """Return an array that torch can take: contiguous, native, writeable, float32 in place of float64."""
    array = np.asarray(value)
    kind = np.dtype(np.float32) if array.dtype == np.float64 else array.dtype.newbyteorder("=")
    array = np.ascontiguousarray(array, dtype=kind)
    return array if array.flags.writeable else array.copy()
