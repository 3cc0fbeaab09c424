"""What a file is by its first bytes and its name, where it is no mesh that is read, and what helps."""

from pathlib import Path

from objectfolder.errors import InputError

_HEAD_BYTES = 512

_MAGIC = (
    (b"version https://git-lfs", "a pointer of Git LFS, not the file itself", "Fetch it: git lfs pull"),
    (b"\x1f\x8b", "compressed by gzip", "Unpack it: gunzip"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", "Unpack it, and name the mesh in it"),
    (b"Rar!", "a rar archive", "Unpack it, and name the mesh in it"),
    (b"%PDF", "a PDF", "Name a mesh"),
    (b"\x89PNG", "a PNG image", "Name a mesh"),
    (b"\xff\xd8\xff", "a JPEG image", "Name a mesh"),
)
"""First bytes, what a file is that has them, and what to do."""

_FORMATS = (
    (b"PK\x03\x04", "a zip archive", (".3mf", ".usdz")),
    (b"BLENDER", "a file of Blender", (".blend",)),
    (b"Kaydara FBX", "an FBX file", (".fbx",)),
    (b"PXR-USDC", "a USD file", (".usdc", ".usd")),
    (b"#usda", "a USD file", (".usda", ".usd")),
    (b"glTF", "a binary glTF", (".glb",)),
    (b"ply\n", "a PLY file", (".ply",)),
    (b"ply\r", "a PLY file", (".ply",)),
    (b"OFF", "an OFF file", (".off",)),
)
"""First bytes of formats that are read, and the endings of their names."""


def refuse_foreign(path: Path) -> None:
    """Raise `InputError` for what is another kind of file than its name says, with the remedy.

    Raises
    ------
    InputError
        An empty file, a pointer, a web page, an archive, a picture, or a mesh of another format.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return  # reading says why
    if not head:
        raise InputError(str(path), "is empty: it holds no faces", "Copy or download it again")
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    if text.startswith((b"<!doctype html", b"<html", b"<head")):
        raise InputError(
            str(path), "cannot be read: it is a web page", "Download the file by its raw address"
        )
    suffix = path.suffix.lower()
    for start, kind, remedy in _MAGIC:
        if head.startswith(start):
            raise InputError(str(path), f"cannot be read: it is {kind}", remedy)
    for start, kind, suffixes in _FORMATS:
        if head.startswith(start) and suffix not in suffixes and not _is_word(head, start):
            remedy = f"Let its name end in {suffixes[0]}"
            if kind == "a zip archive":
                remedy = "Unpack it, and name the mesh in it"
            raise InputError(str(path), f"cannot be read: it is {kind}", remedy)
    if text.startswith(b"{") and b'"asset"' in text and suffix == ".glb":
        raise InputError(str(path), "cannot be read: it is a glTF as text", "Let its name end in .gltf")
    if b"<collada" in text and suffix != ".dae":
        raise InputError(str(path), "cannot be read: it is a COLLADA file", "Let its name end in .dae")


def _is_word(head: bytes, start: bytes) -> bool:
    """Whether the start of an OBJ or STL as text only looks like the magic of OFF."""
    return start == b"OFF" and head[3:4] not in b"\r\n "
