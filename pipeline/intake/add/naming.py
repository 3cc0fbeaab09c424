"""Names that are safe as files, cells and arguments of commands, from names that people chose."""

import re
import unicodedata
from pathlib import Path

LONGEST_ID = 100

GENERIC_STEMS = frozenset(("model", "mesh", "textured", "textured_simple", "scene", "object", "untitled"))
"""Files that collections name alike for all objects: their folder says more."""

GENERIC_FOLDERS = frozenset(("meshes", "mesh", "google_16k", "google_64k", "google_512k", "tsdf", "poisson"))


def object_id_of(mesh: Path) -> str:
    """An identifier from the name of a mesh's file, or of its folder where the file's says nothing."""
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
