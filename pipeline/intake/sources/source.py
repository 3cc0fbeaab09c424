"""What a source of objects declares, so that objects can be fetched from it."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import FormatError, InputError
from objectfolder.making.mesh.readers.material_library import read_material_library
from objectfolder.making.mesh.readers.obj import material_libraries
from pipeline.intake.sources.download import Downloader

REMEDY = "The source's files are at fault, or laid out differently than they were: look at them."
_NOT_IN_NAMES = frozenset('/\\:*?"<>|')


@dataclass(frozen=True)
class Download:
    """One file to download.

    Parameters
    ----------
    url
        Its address; or the path of a file of this machine, which is copied.
    path
        Its place in the object's folder; of an archive its file name.
    size, md5
        Bytes and hash, where the source states them.
    top
        None for a plain file. An archive's members lie under this folder in it, ``""`` for none.
    """

    url: str | Path
    path: str
    size: int | None = None
    md5: str | None = None
    top: str | None = None


class Source(ABC):
    """A published collection; a subclass says what differs from others.

    Attributes
    ----------
    id
        What stands before the colon of ``ycb:025_mug``, and the folder of its objects.
    title, page
        Of the collection; `page` is the address to read about it.
    licence, attribution
        SPDX identifier, and whom to name.
    addresses
        Starts of all addresses that are asked; a mirror stands in their place.
    resolutions
        That can be asked for, the default first.
    absent
        What to say of a name that the source lists and of which it has not what was asked for.
    """

    id: str
    title: str
    page: str
    licence: str
    attribution: str
    addresses: tuple[str, ...]
    resolutions: tuple[str, ...]
    absent: str

    @abstractmethod
    def downloads(self, name: str, resolution: str, documents: Downloader) -> list[Download]:
        """Return what is to be downloaded; AbsentError for no such object."""

    @abstractmethod
    def mesh_and_texture(self, folder: Path, name: str, resolution: str) -> tuple[str, str | None]:
        """Return paths in an object's folder; a texture of None is named by the mesh.

        Raises
        ------
        FormatError
            A file that they need is not there.
        """

    @abstractmethod
    def names(self, documents: Downloader) -> list[str]:
        """Return all names that the source lists, sorted; FormatError for what is no list."""

    @abstractmethod
    def object_page(self, name: str) -> str:
        """Return the address where people find an object."""

    def selects(self, path: str) -> bool:
        """Whether a member of an archive is to be unpacked, by its path in the object's folder."""
        return True

    def check_name(self, name: str) -> None:
        """Refuse a name that no object of the source can have.

        Raises
        ------
        InputError
            It is empty, hidden, or has characters that lead elsewhere or that file systems refuse.
        """
        where = self.source_id(name)
        bad = sorted({letter for letter in name if letter in _NOT_IN_NAMES or not letter.isprintable()})
        if not name or name.startswith(".") or name != name.strip() or bad:
            finding = f"has {' '.join(map(repr, bad))} in it" if bad else f"{name!r} is no name"
            raise InputError(where, finding, "Copy the name from the source's list of objects.")

    def source_id(self, name: str) -> str:
        """Return what names an object among all sources."""
        return f"{self.id}:{name}"


@dataclass(frozen=True)
class SourceObject:
    """An object that a source is asked for, at one of its resolutions.

    The name is that of the source, letters' case and all.
    """

    source: Source
    name: str
    resolution: str

    @property
    def id(self) -> str:
        """What names it among all sources, as ``ycb:025_mug``."""
        return self.source.source_id(self.name)

    def folder(self, root: Path) -> Path:
        """Return its folder."""
        return root / self.source.id / self.name


def obj_texture(folder: Path, mesh: str) -> str | None:
    """Return the path in `folder` of the base colour image of an OBJ in it.

    The name is mended as when the mesh is loaded: blanks after it, and images that lie in
    ``materials/textures`` beside the folder of the library.

    Returns
    -------
    str or None
        None where the materials name several images, or none: the mesh then speaks for itself.

    Raises
    ------
    FormatError
        The mesh, a library or an image is not there, or an image lies outside the folder.
    """
    path = folder / mesh
    if not path.is_file():
        raise FormatError(mesh, "not among the downloaded files", REMEDY)
    try:
        libraries = [read_material_library(path, name) for name in dict.fromkeys(material_libraries(path))]
    except InputError as problem:
        raise FormatError(mesh, f"its material library {problem.finding}", REMEDY) from problem
    images = {material.texture for library in libraries for material in library.values()}
    if len(images) != 1 or None in images:
        return None
    image = next(image for image in images if image is not None).resolve()
    if not image.is_relative_to(folder.resolve()):
        raise FormatError(mesh, "its material library names an image outside the object's folder", REMEDY)
    return image.relative_to(folder.resolve()).as_posix()
