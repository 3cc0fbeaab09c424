"""Meshes that are touched alone: touch needs an object's surface and a sensor, neither views nor modes."""

from collections.abc import Collection
from copy import copy
from functools import cached_property
from pathlib import Path
from typing import Any

from learning.runs import FEWEST, digest
from objectfolder.errors import InputError
from objectfolder.making.mesh.cleaning import clean
from objectfolder.making.mesh.readers.load import load_mesh
from objectfolder.object_file.object_file import SURFACE_TOLERANCE_M
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.contact_surface import ContactSurface
from objectfolder.surface.surface import Surface
from objectfolder.touch import Sensor, read_sensor
from objectfolder.touch.touch_queries import TouchQueries
from objectfolder.touch.touchnet import TouchNet

MESH = "model.obj"


class TouchedMesh:
    """A mesh in metres under a sensor, with the surface that its Object File would store.

    Parameters
    ----------
    name
        Names it in errors.
    path
        The mesh, opened when it is first touched.
    sensor
        What is pressed.
    """

    def __init__(self, name: str, path: Path, sensor: Sensor) -> None:
        self.name, self._path, self._sensor = name, path, sensor

    @cached_property
    def surface(self) -> Surface:
        """The cleaned, compressed and decoded surface."""
        mesh, _ = clean(load_mesh(self._path, None, with_textures=False), self.name)
        return decode_surface(encode_surface(mesh.surface))

    @cached_property
    def _touch(self) -> TouchQueries:
        return TouchQueries(
            TouchNet(self.surface, self._sensor), ContactSurface(self.surface, SURFACE_TOLERANCE_M)
        )

    @property
    def press(self) -> Any:
        """As `ObjectFile.press`."""
        return self._touch.press

    @property
    def reach(self) -> Any:
        """As `ObjectFile.reach`."""
        return self._touch.reach

    @property
    def sample_contacts(self) -> Any:
        """As `ObjectFile.sample_contacts`."""
        return self._touch.sample_contacts


class Meshes:
    """Meshes of a folder, a folder each with its ``model.obj``, as `Objects` has Object Files.

    Parameters
    ----------
    root
        Their folder.
    sensor
        Name of the sensor that presses, or the path of its file.
    most
        Only the first ones by name.

    Raises
    ------
    InputError
        Fewer than `FEWEST`.
    """

    def __init__(self, root: Path, sensor: str, most: int | None = None) -> None:
        paths = {path.parent.name: path for path in sorted(root.glob(f"*/{MESH}"))[:most]}
        self._root, pressed = root, read_sensor(sensor)
        self.files = {name: TouchedMesh(name, path, pressed) for name, path in paths.items()}
        self.digests = {name: digest(path) for name, path in paths.items()}
        self.ids = self._enough(f"folders with a {MESH}")

    def __len__(self) -> int:
        return len(self.ids)

    def without(self, names: Collection[str]) -> "Meshes":
        """Return the others.

        Raises
        ------
        InputError
            Fewer than `FEWEST`.
        """
        subset = copy(self)
        subset.files = {name: file for name, file in self.files.items() if name not in names}
        subset.digests = {name: self.digests[name] for name in subset.files}
        subset.ids = subset._enough("meshes that can be touched")
        return subset

    def _enough(self, counted: str) -> tuple[str, ...]:
        if len(self.files) < FEWEST:
            finding = f"{len(self.files)} {counted}, fewer than {FEWEST}"
            raise InputError(str(self._root), finding, "Name a folder of more such meshes")
        return tuple(self.files)
