"""A mesh copied with everything it refers to, bytes untouched, so that the copy needs nothing else."""

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.geometry.source_files import source_files
from pipeline.intake.add.naming import safe_name


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

    def digest(self) -> str:
        """SHA-256 of all paths and bytes."""
        digest = hashlib.sha256()
        for place, file in sorted(self.files.items()):
            digest.update(f"{place.as_posix()}\0{_sha256(file)}\0".encode("utf-8", "surrogateescape"))
        return digest.hexdigest()


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
    referred = [Path(os.path.normpath(file)) for file in files if file not in (mesh, texture)]
    beside = [Path(os.path.normpath(mesh)), *referred]
    root = Path(os.path.commonpath([file.parent for file in beside]))
    placed = {file.relative_to(root): file for file in beside}
    mesh_place = beside[0].relative_to(root)
    if mesh_place.parent == Path():
        del placed[mesh_place]
        mesh_place = _free(Path((safe_name(mesh.stem) or "model") + mesh.suffix.lower()), placed)
        placed[mesh_place] = mesh
    texture_place = None
    if texture is not None:
        name = (safe_name(texture.stem) or "texture") + texture.suffix.lower()
        texture_place = _free(Path(name), placed)
        placed[texture_place] = texture
    for place in placed:
        if not str(place).isprintable():
            raise InputError(str(mesh), f"refers to a file named {str(place)!r}", "Rename it in both places")
    return Layout(placed, mesh_place, texture_place)


@contextmanager
def copied(layout: Layout, parent: Path, name: str) -> Iterator[Path]:
    """Copy into a hidden folder in `parent`, to be renamed by the caller; it goes away where it is not.

    Raises
    ------
    InputError
        The copy still reads a file from outside, or one changed under the copying.
    """
    parent.mkdir(parents=True, exist_ok=True)
    before = layout.digest()
    folder = Path(tempfile.mkdtemp(prefix=f".{name}.", suffix=".part", dir=parent))
    try:
        for place, file in layout.files.items():
            (folder / place).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, folder / place)
        os.chmod(folder, 0o755)
        _check(layout, folder, before)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def folder_digest(folder: Path) -> str:
    """What `Layout.digest` gives for a folder that holds its files and no other."""
    files = {path.relative_to(folder): path for path in folder.rglob("*") if path.is_file()}
    return Layout(files, Path(), None).digest()


def _check(layout: Layout, folder: Path, before: str) -> None:
    mesh = folder / layout.mesh
    where = str(layout.files[layout.mesh])
    read = source_files(mesh, None if layout.texture is None else folder / layout.texture)
    if {Path(os.path.normpath(file)) for file in read} != {folder / place for place in layout.files}:
        raise InputError(
            where,
            "its copy would read other files than it does",
            "Put all files that it names in its folder, or name the texture with --texture",
        )
    if folder_digest(folder) != before:
        raise InputError(where, "changed while it was copied", "Run it again")


def _free(wanted: Path, taken: dict[Path, Path]) -> Path:
    names = {str(place).casefold() for place in taken}
    place, number = wanted, 1
    while str(place).casefold() in names:
        number += 1
        place = wanted.with_name(f"{wanted.stem}_{number}{wanted.suffix}")
    return place


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
