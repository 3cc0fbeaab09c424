"""Poly Haven, formerly 3D Model Haven: a glTF with its files, listed by an API."""

import json
import re
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote, urlsplit

from objectfolder.errors import FormatError, InputError
from pipeline.intake.sources.source import Documents, Download, Source

API = "https://api.polyhaven.com/"
FILES = "https://dl.polyhaven.org/"
RESOLUTIONS = ("1k", "2k", "4k", "8k")  # side of the textures; the mesh is the same
MOST_FILES = 1000
LARGEST_GLTF_BYTES = 64 << 20
_SLUG = re.compile(r"[A-Za-z0-9_-]{1,50}")
_MD5 = re.compile(r"[0-9a-fA-F]{32}")


def downloads(name: str, resolution: str, documents: Documents) -> list[Download]:
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
    listed = documents.json(address)
    try:
        if "gltf" not in listed:
            raise InputError(f"polyhaven:{name}", "is no model: it has no glTF", "Name a model of its list.")
        if resolution not in listed["gltf"]:
            there = ", ".join(sorted(listed["gltf"], key=_thousands))
            raise InputError(f"polyhaven:{name}", f"has no glTF of {resolution}", f"It has {there}.")
        main = listed["gltf"][resolution]["gltf"]
        found = [_download(address, main["url"].rpartition("/")[2], main)]
        found += [_download(address, path, entry) for path, entry in main.get("include", {}).items()]
    except (KeyError, TypeError, AttributeError) as problem:
        raise FormatError(address, f"no list of files ({problem!r})", "Its API has changed.") from problem
    paths = {entry.path.casefold() for entry in found}
    if len(paths) != len(found) or len(found) > MOST_FILES:
        raise FormatError(address, f"lists {len(found)} files of {len(paths)} names", "Its API is wrong.")
    return found


def mesh_and_texture(folder: Path, name: str, resolution: str) -> tuple[str, str | None]:
    """Return the glTF, which names its own images: base colour, roughness and metallic.

    Raises
    ------
    FormatError
        It names a file that the list did not have.
    """
    found = sorted(path.name for path in folder.glob(f"*_{resolution}.gltf"))
    if len(found) != 1:
        raise FormatError(name, f"{len(found)} glTF files of {resolution} came", "There should be one.")
    _check_complete(folder / found[0])
    return found[0], None


def names(documents: Documents) -> list[str]:
    """Return the slugs of all models."""
    address = f"{API}assets?type=models"
    listed = documents.json(address)
    entries = list(listed.values()) if isinstance(listed, dict) else []
    if not entries or not all(isinstance(entry, dict) for entry in entries):
        raise FormatError(address, "no list of models", "Look at it in a browser, or use a mirror.")
    return sorted(listed)


def check_name(name: str) -> None:
    """Refuse what is no slug."""
    if not _SLUG.fullmatch(name):
        raise InputError(
            f"polyhaven:{name}",
            "is no slug: letters, digits, '_' and '-', at most 50",
            "Copy the end of the address of its page, as Television_01 of polyhaven.com/a/Television_01.",
        )


def _download(address: str, path: str, entry: dict[str, Any]) -> Download:
    url, size, md5 = entry["url"], entry.get("size"), entry.get("md5")
    parts = PurePosixPath(path).parts
    if path != "/".join(parts) or any(part in ("..", "/") or "\\" in part or ":" in part for part in parts):
        raise FormatError(address, f"lists the file {path!r}, which leads elsewhere", "Its API is wrong.")
    place = urlsplit(url)
    if place.scheme != "https" or not f".{place.hostname}".endswith((".polyhaven.org", ".polyhaven.com")):
        raise FormatError(address, f"lists an address elsewhere ({url})", "Its API is wrong or has moved.")
    if (size is not None and type(size) is not int) or (md5 is not None and not _MD5.fullmatch(md5)):
        raise FormatError(address, f"says of {path!r} size {size!r} and md5 {md5!r}", "Its API is wrong.")
    return Download(url, path, size, None if md5 is None else md5.lower())


def _check_complete(mesh: Path) -> None:
    """Raise `FormatError` unless every buffer and image of a glTF is beside it."""
    try:
        if mesh.stat().st_size > LARGEST_GLTF_BYTES:
            raise ValueError(f"its JSON has more than {LARGEST_GLTF_BYTES} bytes")
        said = json.loads(mesh.read_bytes())
        named = [entry.get("uri", "data:") for kind in ("buffers", "images") for entry in said.get(kind, [])]
        missing = [
            uri for uri in named if not uri.startswith("data:") and not (mesh.parent / unquote(uri)).is_file()
        ]
    except (ValueError, TypeError, AttributeError, OSError, RecursionError) as problem:
        raise FormatError(
            mesh.name, f"no glTF ({problem})", "The source is at fault; try later."
        ) from problem
    if missing:
        raise FormatError(
            mesh.name,
            f"names {missing[0]!r}, which its list of files does not have",
            "The source is at fault.",
        )


def _thousands(resolution: str) -> tuple[int, str]:
    digits = re.match(r"\d+", resolution)
    return int(digits[0]) if digits else 0, resolution


SOURCE = Source(
    id="polyhaven",
    title="Poly Haven",
    page="https://polyhaven.com/models",
    licence="CC0-1.0",
    attribution="Poly Haven (polyhaven.com)",
    addresses=(API, FILES),
    resolutions=RESOLUTIONS,
    downloads=downloads,
    wanted=lambda path: True,
    mesh_and_texture=mesh_and_texture,
    names=names,
    object_page=lambda name: f"https://polyhaven.com/a/{name}",
    absent="The model is listed, but its files are not. Try again later.",
    check_name=check_name,
)
