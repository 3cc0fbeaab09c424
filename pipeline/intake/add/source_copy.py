"""A mesh copied with everything it refers to, bytes untouched, so that the copy needs nothing else."""

import hashlib
import os
import re
import shutil
import tempfile
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.load import source_files
from objectfolder.products.provenance import file_digest

LONGEST_ID = 100

GENERIC_STEMS = frozenset(("model", "mesh", "textured", "textured_simple", "scene", "object", "untitled"))
"""Files that collections name alike for all objects: their folder says more."""

GENERIC_FOLDERS = frozenset(("meshes", "mesh", "google_16k", "google_64k", "google_512k", "tsdf", "poisson"))


def object_id_of(mesh: Path) -> str:
    """Return an identifier from the name of the mesh file, or of its folder if the file's name is generic."""
    mesh = mesh.absolute()
    stem = mesh.stem
    if stem.casefold() in GENERIC_STEMS:
        folders = [folder.name for folder in mesh.parents if folder.name.casefold() not in GENERIC_FOLDERS]
        stem = folders[0] if folders and folders[0] else stem
    return safe_name(stem) or "object"


def safe_name(text: str) -> str:
    """Letters without their accents, digits, ``_ . -``, not starting with a dot or a dash; may be empty."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode("ascii")
    return re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9_.-]", "_", plain)).strip("._-")[:LONGEST_ID]


def words_of(object_id: str) -> str:
    """A name in words from an identifier."""
    return re.sub(r"[_\s]+", " ", object_id).strip() or object_id


@dataclass(frozen=True)
class Layout:
    """Where each file goes, relative to the object's folder.

    Parameters
    ----------
    files
        Files as they are, by their path in the folder.
    mesh, texture
        Paths in the folder; a texture of None follows the mesh.
    """

    files: dict[Path, Path]
    mesh: Path
    texture: Path | None


def layout_of(mesh: Path, texture: Path | None) -> Layout:
    """Lay out what `load_mesh(mesh, texture)` reads, so that every reference in it still holds.

    Names that files refer to stay, with the folders between them; the mesh and the texture named beside it
    are given safe names where they are referred to by nothing but the table.

    Raises
    ------
    InputError
        A name that no table can hold.
    """
    mesh = mesh.absolute()
    texture = None if texture is None else texture.absolute()
    files = [file.absolute() for file in source_files(mesh, texture)]
    more = [Path(os.path.normpath(file)) for file in files if file not in (mesh, texture)]
    beside = [Path(os.path.normpath(mesh)), *more]
    root = Path(os.path.commonpath([file.parent for file in beside]))
    targets = {file.relative_to(root): file for file in beside}
    mesh_place = beside[0].relative_to(root)
    if mesh_place.parent == Path():
        del targets[mesh_place]
        mesh_place = _free(Path((safe_name(mesh.stem) or "model") + mesh.suffix.lower()), targets)
        targets[mesh_place] = mesh
    texture_place = None
    if texture is not None:
        name = (safe_name(texture.stem) or "texture") + texture.suffix.lower()
        texture_place = _free(Path(name), targets)
        targets[texture_place] = texture
    for place in targets:
        if not str(place).isprintable():
            raise InputError(str(mesh), f"refers to a file named {str(place)!r}", "Rename it in both places")
    return Layout(targets, mesh_place, texture_place)


def copy_files(layout: Layout, folder: Path) -> None:
    """Copy the files into a folder that takes its name when all are there.

    Raises
    ------
    InputError
        The copy still reads a file from outside, or one changed while it was copied.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    before = digest_of(layout.files)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent))
    try:
        for place, file in layout.files.items():
            (temporary / place).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, temporary / place)
        temporary.chmod(0o755)
        where = str(layout.files[layout.mesh])
        sources = source_files(temporary / layout.mesh, layout.texture and temporary / layout.texture)
        if {Path(os.path.normpath(file)) for file in sources} != {
            temporary / place for place in layout.files
        }:
            raise InputError(
                where,
                "its copy would read other files than it does",
                "Put all files that it names in its folder, or name the texture with --texture",
            )
        if folder_digest(temporary) != before:
            raise InputError(where, "changed while it was copied", "Run it again")
        temporary.rename(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def digest_of(files: Mapping[Path, Path]) -> str:
    """Return the SHA-256 of all paths, which are the keys, and of the bytes of the files."""
    digest = hashlib.sha256()
    for place, path in sorted(files.items()):
        digest.update(f"{place.as_posix()}\0{file_digest(path)}\0".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()


def folder_digest(folder: Path) -> str:
    """Return what `digest_of` gives for all files of a folder, by their paths in it."""
    return digest_of({path.relative_to(folder): path for path in folder.rglob("*") if path.is_file()})


def _free(path: Path, places: dict[Path, Path]) -> Path:
    names = {str(place).casefold() for place in places}
    place, number = path, 1
    while str(place).casefold() in names:
        number += 1
        place = path.with_name(f"{path.stem}_{number}{path.suffix}")
    return place
