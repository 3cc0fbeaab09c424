"""Worlds of a data set's objects, which do not travel: each process that asks for one makes it, once."""

from collections.abc import Collection, Iterator, Mapping
from functools import cache
from pathlib import Path

import numpy as np

from learning.grasping.world import PARTS, World
from learning.runs import Objects, kept
from objectfolder import load
from objectfolder.errors import InputError
from objectfolder.object_file import ObjectFile
from objectfolder.simulators.collision import convex_parts
from objectfolder.simulators.parts_product import parts_product
from objectfolder.surface.surface import Surface


class Worlds(Mapping[str, World]):
    """The worlds of all objects with a mass, by name and in order.

    Parameters
    ----------
    objects
        Of the data set.
    left_out
        Names of objects that are not read at all.

    Raises
    ------
    InputError
        No other object has a mass.

    Attributes
    ----------
    digests
        Of their Object Files.
    """

    def __init__(self, objects: Objects, left_out: Collection[str] = ()) -> None:
        names = sorted(set(objects.ids).difference(left_out))
        heavy = [name for name in names if objects.files[name].description["body"] is not None]
        if not heavy:
            folder = str(objects.root / "data" / "object_files")
            raise InputError(folder, "no object has a mass", "Stage `fidelity` writes it: `make dataset`")
        self._paths = {name: objects.paths[name] for name in heavy}
        self.digests = {name: objects.digests[name] for name in heavy}

    def __getitem__(self, name: str) -> World:
        return world_at(self._paths[name], self.digests[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)

    def part(self, name: str) -> None:
        """Part an object, if it has not been: that takes longest, and is kept."""
        _parts(self._paths[name], self.digests[name])


@cache
def world_at(path: Path, digest: str) -> World:
    """Return the world of an Object File, whose parts are `PARTS` at most."""
    return World(load(path), _parts(path, digest))


def _parts(path: Path, digest: str) -> list[Surface]:
    key = {"unit": "parts", "file": digest, "parts": PARTS}
    arrays = kept(__name__, key, lambda: _parted(load(path)))
    vertices = np.split(arrays["vertices"], np.cumsum(arrays["corners"])[:-1])
    faces = np.split(arrays["faces"], np.cumsum(arrays["sides"])[:-1])
    return [Surface(*hull) for hull in zip(vertices, faces, strict=True)]


def _parted(file: ObjectFile) -> dict[str, np.ndarray]:
    parts = convex_parts(file.surface, most_parts=PARTS, name=file.description["object"]["name"])
    return {name: array.data for name, array in parts_product(parts).arrays.items()}
