"""MJCF bounded before MuJoCo reads it: a few words can ask for millions of bodies, or for all memory."""

import math
from pathlib import Path
from xml.etree import ElementTree

from objectfolder.errors import InputError

MOST_SCENE_ELEMENTS = 20_000  # with those that are written once and come many times
MOST_GRID_VALUES = 1 << 24  # texels of a texture, heights of a field
MOST_TEXT_BYTES, MOST_FILE_BYTES, MOST_FILES = 8 << 20, 128 << 20, 1000
DEEPEST = 60
FILES_OF_MJCF = ("include", "model")
FOLDERS = ("meshdir", "texturedir", "assetdir")
GRIDS = (("nrow", "ncol"), ("width", "height"), ("gridsize",), ("resolution",))
REPEATED = ("replicate", "composite", "flexcomp")
SCENE_REMEDY = "Look at who made the scene, or make one: objectfolder scene."


def check_scene(scene: Path) -> None:
    """Refuse a scene that would take much memory or time, with the MJCF and the files that it names.

    Raises
    ------
    InputError
        No XML, or more of something than a scene of objects has: elements, also by repetition, values of a
        grid, bytes or files; a name of what is no file; a plugin.
    """
    if not scene.is_file():
        raise InputError(str(scene), "no scene: there is no such file", SCENE_REMEDY)
    _Scan(scene).elements(scene)


class _Scan:
    """Counts what a scene asks for, its files once each."""

    def __init__(self, scene: Path) -> None:
        self._scene = scene
        self._counts: dict[Path, int] = {}

    def elements(self, path: Path) -> int:
        """Return how many elements a file of MJCF becomes."""
        path = path.resolve()
        if path in self._counts:
            return self._counts[path]
        if len(self._counts) >= MOST_FILES:
            raise self._error(f"names more than {MOST_FILES} files of MJCF")
        self._counts[path] = 0  # in itself it counts as nothing: MuJoCo refuses that
        root = self._parsed(path)
        folders = [
            path.parent / element.get(name, "") for element in root.iter("compiler") for name in FOLDERS
        ]
        models: dict[str, int] = {}
        for element in root.iter():
            self._check_grid(element)
            if (file := element.get("file")) is not None:
                places = [folder / file for folder in (path.parent, *folders)]
                existing = next((place for place in places if place.exists()), None)
                if existing is not None:
                    self._check_file(existing)
                    if element.tag in FILES_OF_MJCF:
                        models[element.get("name", file) if element.tag == "model" else file] = self.elements(
                            existing
                        )
        self._counts[path] = sum(self._count(element, models, 0) for element in root)
        return self._counts[path]

    def _parsed(self, path: Path) -> ElementTree.Element:
        self._check_file(path, MOST_TEXT_BYTES)
        text = path.read_bytes()
        if b"<!DOCTYPE" in text:  # entities, which expat bounds, and MuJoCo does not know
            raise self._error("declares a type of document, which no MJCF does")
        try:
            return ElementTree.fromstring(text)
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            raise self._error(f"no scene of MuJoCo: {path.name}: {error}") from error

    def _count(self, element: ElementTree.Element, models: dict[str, int], depth: int) -> int:
        """Return how many elements an element becomes, those inside counted."""
        if depth > DEEPEST:
            raise self._error(f"is nested more than {DEEPEST} deep")
        if element.tag in ("extension", "plugin"):
            raise self._error("names a plugin")
        times = math.prod(_whole_numbers(element.get("count", ""))) if element.tag in REPEATED else 1
        model = {"attach": element.get("model", ""), "include": element.get("file", "")}.get(element.tag, "")
        inside = sum(self._count(part, models, depth + 1) for part in element)
        count = max(1, times) * (1 + models.get(model, 0) + inside)
        if count > MOST_SCENE_ELEMENTS:
            raise self._error(f"becomes more than {MOST_SCENE_ELEMENTS} elements at <{element.tag}>")
        return count

    def _check_grid(self, element: ElementTree.Element) -> None:
        for names in GRIDS:
            values = math.prod(number for name in names for number in _whole_numbers(element.get(name, "")))
            if values > MOST_GRID_VALUES:
                raise self._error(f"<{element.tag}> has {values} values, more than {MOST_GRID_VALUES}")

    def _check_file(self, path: Path, most: int = MOST_FILE_BYTES) -> None:
        if not path.is_file():  # a device has no end
            raise self._error(f"names {path}, which is no file")
        if path.stat().st_size > most:
            raise self._error(f"names {path} of {path.stat().st_size} bytes, more than {most}")

    def _error(self, finding: str) -> InputError:
        return InputError(str(self._scene), finding, SCENE_REMEDY)


def _whole_numbers(text: str) -> list[int]:
    """Return the numbers of an attribute; none where MuJoCo will refuse it."""
    try:
        return [int(float(word)) for word in text.split()]
    except (ValueError, OverflowError):
        return []
