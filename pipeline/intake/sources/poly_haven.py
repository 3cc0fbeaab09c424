"""Poly Haven, formerly 3D Model Haven: a glTF with its files, listed by an API."""

import re
from pathlib import Path, PurePosixPath
from typing import Annotated, Any
from urllib.parse import unquote, urlsplit

from pydantic import BaseModel, Field, StrictInt

from objectfolder.errors import FormatError, InputError
from objectfolder.making.mesh.readers.gltf_file import read_gltf_file
from pipeline.intake.sources.download import Downloader
from pipeline.intake.sources.source import Download, Source

API = "https://api.polyhaven.com/"
FILES = "https://dl.polyhaven.org/"
MOST_FILES = 1000
_SLUG = re.compile(r"[A-Za-z0-9_-]{1,50}")


class _ListedFile(BaseModel):
    """A file as the API lists it, with those that it includes by their paths."""

    url: str
    size: StrictInt | None = None
    md5: Annotated[str, Field(pattern=r"^[0-9a-fA-F]{32}$")] | None = None
    include: dict[str, "_ListedFile"] = {}


class _Form(BaseModel):
    gltf: _ListedFile


class _Answer(BaseModel):
    """What the API answers for a model: its glTF by resolution."""

    gltf: dict[str, _Form] = {}


class PolyHaven(Source):
    """The models of Poly Haven."""

    id = "polyhaven"
    title = "Poly Haven"
    page = "https://polyhaven.com/models"
    licence = "CC0-1.0"
    attribution = "Poly Haven (polyhaven.com)"
    addresses = (API, FILES)
    resolutions = ("1k", "2k", "4k", "8k")  # side of the textures; the mesh is the same
    absent = "The model is listed, but its files are not. Try again later."

    def downloads(self, name: str, resolution: str, documents: Downloader) -> list[Download]:
        """Return the glTF and what it includes, as the API lists them with their own addresses and hashes.

        Raises
        ------
        FormatError
            The list is not one, or a file of it leads out of the folder or to a host of others.
        InputError
            No glTF of this resolution.
        AbsentError
            No such object.
        """
        address = f"{API}files/{name}"
        forms = documents.json(address, _Answer).gltf
        if resolution not in forms:
            available = ", ".join(sorted(forms, key=lambda form: (len(form), form)))
            raise InputError(
                self.source_id(name), f"has no glTF of {resolution}", f"It has {available or 'none'}."
            )
        main = forms[resolution].gltf
        files = {main.url.rpartition("/")[2]: main, **main.include}
        for path, entry in files.items():
            _check_place(address, path, entry.url)
        names = {path.casefold() for path in files}
        if len(names) != 1 + len(main.include) or len(files) > MOST_FILES:
            raise FormatError(address, f"lists {len(files)} files of {len(names)} names", "Its API is wrong.")
        return [Download(entry.url, path, entry.size, entry.md5) for path, entry in files.items()]

    def mesh_and_texture(self, folder: Path, name: str, resolution: str) -> tuple[str, str | None]:
        """Return the glTF, which names its own images: base colour, roughness and metallic."""
        meshes = sorted(path.name for path in folder.glob(f"*_{resolution}.gltf"))
        if len(meshes) != 1:
            raise FormatError(name, f"has {len(meshes)} glTF files of {resolution}", "There should be one.")
        _check_complete(folder / meshes[0])
        return meshes[0], None

    def names(self, documents: Downloader) -> list[str]:
        """Return the slugs of all models."""
        models = Annotated[dict[str, dict[str, Any]], Field(min_length=1)]
        return sorted(documents.json(f"{API}assets?type=models", models))

    def object_page(self, name: str) -> str:
        """Return the page of a model."""
        return f"https://polyhaven.com/a/{name}"

    def check_name(self, name: str) -> None:
        """Refuse what is no slug."""
        if not _SLUG.fullmatch(name):
            raise InputError(
                self.source_id(name),
                "is not a slug: letters, digits, '_' and '-', at most 50",
                "Copy the end of the address of its page, as Television_01 of polyhaven.com/a/Television_01.",
            )


def _check_place(address: str, path: str, url: str) -> None:
    """Raise `FormatError` for a path that leads out of the folder, or an address that is not the source's."""
    parts = PurePosixPath(path).parts
    if path != "/".join(parts) or any(part in ("..", "/") or "\\" in part or ":" in part for part in parts):
        raise FormatError(address, f"lists the file {path!r}, which leads elsewhere", "Its API is wrong.")
    place = urlsplit(url)
    if place.scheme != "https" or not f".{place.hostname}".endswith((".polyhaven.org", ".polyhaven.com")):
        raise FormatError(address, f"lists an address elsewhere ({url})", "Its API is wrong or has moved.")


def _check_complete(mesh: Path) -> None:
    """Raise `FormatError` unless every buffer and image of a glTF is beside it."""
    remedy = "The source is at fault; try later."
    try:
        header = read_gltf_file(mesh).header
        uris = [entry.get("uri", "data:") for kind in ("buffers", "images") for entry in header.get(kind, [])]
        missing = [
            uri for uri in uris if not uri.startswith("data:") and not (mesh.parent / unquote(uri)).is_file()
        ]
    except (InputError, TypeError, ValueError, AttributeError, OSError) as problem:
        raise FormatError(mesh.name, f"no glTF ({problem})", remedy) from problem
    if missing:
        finding = f"names {missing[0]!r}, which its list of files does not have"
        raise FormatError(mesh.name, finding, remedy)
