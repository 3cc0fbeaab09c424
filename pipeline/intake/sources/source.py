"""What a source of objects declares, so that objects can be fetched from it."""

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import InputError
from pipeline.intake.sources.download import Downloader

LONGEST_NAME_BYTES = 200  # of a file system's 255, which temporary names share
_NOT_IN_NAMES = frozenset('/\\:*?"<>|')


@dataclass(frozen=True)
class Download:
    """One file to download.

    Parameters
    ----------
    url
        Its address.
    path
        Its place in the object's folder; of an archive its file name.
    size, md5
        Bytes and hash, where the source states them.
    top
        None for a plain file. An archive's members lie under this folder in it, ``""`` for none.
    """

    url: str
    path: str
    size: int | None = None
    md5: str | None = None
    top: str | None = None


@dataclass(frozen=True)
class Source:
    """A published collection; everything in it that differs from others.

    Parameters
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
    downloads
        From name, resolution and documents, what is to be downloaded.
    wanted
        Whether a member of an archive is, by its path in the object's folder.
    mesh_and_texture
        From an object's folder, name and resolution, paths in it; a texture of None is the mesh's own affair.
    names
        From documents, all names that the source lists.
    object_page
        From a name, the address where people find the object.
    absent
        What to say of a name that the source lists and of which it has not what was asked for.
    check_name
        Raises `InputError` for a name that no object of the source can have.
    """

    id: str
    title: str
    page: str
    licence: str
    attribution: str
    addresses: tuple[str, ...]
    resolutions: tuple[str, ...]
    downloads: Callable[[str, str, Downloader], list[Download]]
    wanted: Callable[[str], bool]
    mesh_and_texture: Callable[[Path, str, str], tuple[str, str | None]]
    names: Callable[[Downloader], list[str]]
    object_page: Callable[[str], str]
    absent: str
    check_name: Callable[[str], None]

    def source_id(self, name: str) -> str:
        """Return what names an object among all sources."""
        return f"{self.id}:{name}"


@dataclass(frozen=True)
class SourceObject:
    """An object that a source is asked for.

    Parameters
    ----------
    source, name
        Which; the name is that of the source, letters' case and all.
    resolution
        One of the source's.
    """

    source: Source
    name: str
    resolution: str

    @classmethod
    def of(cls, source: Source, name: str, resolution: str | None = None) -> "SourceObject":
        """Check a name, and take the source's default for a resolution of None; InputError for others."""
        source.check_name(name)
        if resolution is not None and resolution not in source.resolutions:
            there = ", ".join(source.resolutions)
            raise InputError(source.title, f"has no resolution {resolution!r}", f"It has {there}.")
        return cls(source, name, resolution or source.resolutions[0])

    @property
    def id(self) -> str:
        """What names it among all sources, as ``ycb:025_mug``."""
        return self.source.source_id(self.name)

    def downloads(self, documents: Downloader) -> list[Download]:
        """Return what is to be downloaded."""
        return self.source.downloads(self.name, self.resolution, documents)

    def folder(self, root: Path) -> Path:
        """Return its folder."""
        return root / self.source.id / self.name


def check_file_name(source_id: str, name: str) -> None:
    """Refuse a name that cannot be a folder everywhere.

    Raises
    ------
    InputError
        It is empty, too long, hidden, or has characters that lead elsewhere or that file systems refuse.
    """
    bad = sorted({letter for letter in name if letter in _NOT_IN_NAMES or not letter.isprintable()})
    if not name or name.startswith(".") or name != name.strip() or bad:
        finding = f"has {' '.join(map(repr, bad))} in it" if bad else f"{name!r} is no name"
        raise InputError(source_id, finding, "Copy the name from the source's list of objects.")
    if len(name.encode("utf-8", "surrogatepass")) > LONGEST_NAME_BYTES:
        raise InputError(
            source_id, f"longer than {LONGEST_NAME_BYTES} bytes", "Names of objects are shorter."
        )


def near_names(name: str, names: Sequence[str]) -> list[str]:
    """Return at most three of `names` that were perhaps meant; letters' case does not count."""
    by_folded = {known.casefold(): known for known in reversed(names)}
    folded = name.casefold()
    near = difflib.get_close_matches(folded, by_folded, n=3, cutoff=0.6)
    within = sorted((known for known in by_folded if folded and folded in known), key=len)
    return [by_folded[known] for known in dict.fromkeys([*near, *within])][:3]
