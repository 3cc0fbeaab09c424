"""What a file is by its first bytes and its name, where it is no mesh that is read, and what helps."""

import shlex
from pathlib import Path

from objectfolder.errors import InputError

_HEAD_BYTES = 512

_MAGIC = (
    (b"version https://git-lfs", "a pointer of Git LFS, not the file itself", "Fetch it: git lfs pull"),
    (b"\x1f\x8b", "compressed by gzip", "Unpack it: gunzip"),
    (b"PK\x03\x04", "a zip archive", "Unpack it, and name the mesh in it"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", "Unpack it, and name the mesh in it"),
    (b"Rar!", "a rar archive", "Unpack it, and name the mesh in it"),
    (b"%PDF", "a PDF", "Name a mesh"),
    (b"\x89PNG", "a PNG image", "Name a mesh"),
    (b"\xff\xd8\xff", "a JPEG image", "Name a mesh"),
    (b"BLENDER", "a file of Blender", ".blend"),
    (b"Kaydara FBX", "an FBX file", ".fbx"),
    (b"PXR-USDC", "a USD file", ".usdc"),
    (b"#usda", "a USD file", ".usda"),
    (b"glTF", "a binary glTF", "Let its name end in .glb"),
    (b"ply\n", "a PLY file", "Let its name end in .ply"),
    (b"ply\r", "a PLY file", "Let its name end in .ply"),
    (b"OFF", "an OFF file", ".off"),
)
"""First bytes, what a file is that has them, and what to do, or the suffix whose remedy it is."""

_OWN = {b"glTF": (".glb",), b"ply\n": (".ply",), b"ply\r": (".ply",)}

_BLENDER_IMPORT = {
    ".fbx": "bpy.ops.import_scene.fbx(filepath={0!r})",
    ".blend": "bpy.ops.wm.open_mainfile(filepath={0!r})",
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), "bpy.ops.wm.usd_import(filepath={0!r})"),
}
"""What Blender, which is a package of the extra factory, reads."""

_TRIMESH = {".3mf": ".ply", ".dae": ".obj", ".off": ".ply"}
"""What trimesh reads, 3MF and DAE with packages that it names, and to what, which has z up as these have."""


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
        if head.startswith(start) and suffix not in _OWN.get(start, ()) and not _is_word(head, start):
            raise InputError(str(path), f"cannot be read: it is {kind}", conversion(path, remedy) or remedy)
    if b"<collada" in text:
        raise InputError(str(path), "cannot be read: it is a COLLADA file", conversion(path, ".dae") or "")


def conversion(path: Path, suffix: str) -> str | None:
    """Return the sentence that makes a mesh that is read of one of another format; None for one not known.

    >>> conversion(Path("cup.off"), ".off")
    'Convert it: python -c "import trimesh; trimesh.load(\\'cup.off\\').export(\\'cup.ply\\')"'
    """
    source, result = str(path), str(path.with_suffix(_TRIMESH.get(suffix, ".glb")))
    if suffix in _BLENDER_IMPORT:
        read = _BLENDER_IMPORT[suffix].format(source)
        empty = "" if suffix == ".blend" else "bpy.ops.wm.read_factory_settings(use_empty=True); "
        program = f"import bpy; {empty}{read}; bpy.ops.export_scene.gltf(filepath={result!r})"
    elif suffix in _TRIMESH:
        program = f"import trimesh; trimesh.load({source!r}).export({result!r})"
    else:
        return None
    quoted = shlex.quote(program) if '"' in program else f'"{program}"'
    return f"Convert it: python -c {quoted}"


def _is_word(head: bytes, start: bytes) -> bool:
    """Whether the start of an OBJ or STL as text only looks like the magic of OFF."""
    return start == b"OFF" and head[3:4] not in b"\r\n "
