"""The parts of a glTF or GLB file: its JSON, the bytes of its buffers and images, the numbers of primitives.

Read here and not with trimesh, which takes sparse accessors for zeros, normalised integers for whole numbers
and what it cannot decode for nothing, leaves out texture transforms and vertex colours beside a material,
skips fans, and joins parts in an order that differs from run to run.
"""

import base64
import binascii
import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import brief, find_file, read_bytes, shortened, usual_places

KINDS = {".gltf": "glTF", ".glb": "binary glTF"}

DRACO = "KHR_draco_mesh_compression"
TEXTURE_TRANSFORM = "KHR_texture_transform"
WEBP = "EXT_texture_webp"
GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"
_SUPPORTED = (DRACO, TEXTURE_TRANSFORM, WEBP, "KHR_mesh_quantization", "KHR_node_visibility", GLOSSINESS)
VISIBILITY = "KHR_node_visibility"
_HARMLESS = ("KHR_materials_", "KHR_lights_", "KHR_xmp", "KHR_animation_pointer")
_SEEN = (
    "KHR_materials_transmission", "KHR_materials_volume", "KHR_materials_diffuse_transmission",
    "KHR_materials_variants",
)  # fmt: skip
"""Of the materials' extensions, those by which it looks otherwise: glass is drawn opaque, variants as one."""
_REMEDIES = {
    "EXT_meshopt_compression": "Export it without meshopt compression, or with Draco",
    "KHR_meshopt_compression": "Export it without meshopt compression, or with Draco",
    "KHR_texture_basisu": "Export its textures as PNG, JPEG or WebP",
    "EXT_mesh_gpu_instancing": "Export its instances as nodes of their own",
}

Json = dict[str, Any]


class Gltf:
    """A glTF file whose indices are checked as they are followed.

    Parameters
    ----------
    path
        The file, for what it names and for errors.
    header
        Its JSON.
    chunk
        The binary chunk of a GLB file.
    """

    def __init__(self, path: Path, header: Json, chunk: bytes | None) -> None:
        self.path = path
        self.header = header
        self._chunk = chunk
        self._buffers: dict[int, bytes] = {}
        self.remarks: list[str] = []

    def remark(self, text: str) -> None:
        """Note, once, what is read otherwise than the file says it, or left out, and shows."""
        if text not in self.remarks:
            self.remarks.append(text)

    def entry(self, kind: str, index: Any) -> Json:
        """Return one entry of a list of the file; ValueError where there is none."""
        entries = self.header.get(kind, [])
        number = whole(index)
        if not isinstance(entries, list) or number >= len(entries):
            raise ValueError(f"{kind} has no entry {number}")
        if not isinstance(entries[number], dict):
            raise ValueError(f"entry {number} of {kind} is no object")
        return dict(entries[number])

    def view(self, index: Any) -> memoryview:
        """Return the bytes of a buffer view, not copied."""
        view = self.entry("bufferViews", index)
        for name in extensions(view):
            if name in _REMEDIES and "fallback" in extensions(self.entry("buffers", view["buffer"])).get(
                name, {}
            ):
                raise self.unsupported(name)
        start, length = whole(view.get("byteOffset", 0)), whole(view["byteLength"])
        data = self._buffer(whole(view["buffer"]))
        if start + length > len(data):
            raise ValueError(f"buffer view {index} ends behind its buffer of {len(data)} bytes")
        return memoryview(data)[start : start + length]

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            entry = self.entry("buffers", index)
            if "uri" in entry:
                data = self.named(entry["uri"])
                if data is None:
                    raise ValueError(f"its buffer {shortened(str(entry['uri']))} is not in its folder")
            elif index == 0 and self._chunk is not None:
                data = self._chunk
            else:
                raise ValueError(f"buffer {index} has no bytes")
            if len(data) < whole(entry["byteLength"]):
                raise ValueError(f"buffer {index} has {len(data)} bytes of {entry['byteLength']}")
            self._buffers[index] = data
        return self._buffers[index]

    def named(self, uri: Any) -> bytes | None:
        """Return the bytes that a URI holds, or those of the file it names; None where that is not there."""
        if not isinstance(uri, str):
            raise ValueError(f"{shortened(str(uri))} is no URI")
        if uri.startswith("data:"):
            media_type, _, content = uri.partition(",")
            if not media_type.endswith(";base64"):
                raise ValueError("a data URI that is not in base64")
            try:
                return base64.b64decode(content, validate=True)
            except binascii.Error as problem:
                raise ValueError(f"a data URI that is no base64 ({problem})") from problem
        file = named_file(self.path, uri)
        return None if file is None else read_bytes(file)

    def unsupported(self, *names: str) -> InputError:
        """Return the error for extensions that are not read."""
        return _unsupported(self.path, names)


def read_gltf_file(path: Path) -> Gltf:
    """Read the JSON of a glTF or GLB file, and the binary chunk of the latter.

    Raises
    ------
    InputError
        It is none, is of another version than 2, is cut short, or needs an extension that is not supported.
    """
    kind = KINDS[path.suffix.lower()]
    data, chunk = read_bytes(path), None
    try:
        if path.suffix.lower() == ".glb":
            data, chunk = _chunks(data)
        header = json.loads(data.decode("utf-8-sig"), parse_constant=_refuse_constant)
        if not isinstance(header, dict) or not isinstance(header.get("asset"), dict):
            raise ValueError("no glTF asset in it")
        version = str(header["asset"].get("version", "2.0"))
        if version.split(".")[0] != "2":
            raise ValueError(f"its version is {shortened(version)}, and 2.0 is read")
        required = header.get("extensionsRequired", [])
        if not isinstance(required, list) or not all(isinstance(name, str) for name in required):
            raise ValueError("its list of extensions is none")
    except (ValueError, struct.error, RecursionError) as problem:
        raise InputError(
            str(path), f"cannot be read as {kind} ({brief(problem)})", "Export the mesh again"
        ) from problem
    foreign = [name for name in required if name not in _SUPPORTED and not name.startswith(_HARMLESS)]
    if foreign:
        raise _unsupported(path, foreign)
    file = Gltf(path, header, chunk)
    if ignored := ignored_extensions(header.get("extensionsUsed", []), required):
        file.remark(f"it uses glTF extensions that are not read: {', '.join(ignored)}")
    return file


def ignored_extensions(used: Any, required: Sequence[str]) -> list[str]:
    """Return, of the extensions that a file uses, those that change what is seen and are not read.

    Not those of materials that leave the base colour as it is, of lights and of descriptions; what has a
    fallback is refused elsewhere where it has none.
    """
    names = used if isinstance(used, list) else []
    harmless = (*_SUPPORTED, *_REMEDIES, *required)
    return sorted(
        shortened(name)[1:-1]
        for name in {name for name in names if isinstance(name, str)}
        if name not in harmless and (name in _SEEN or not name.startswith(_HARMLESS))
    )


def gltf_files(path: Path, *, with_images: bool) -> list[Path]:
    """List the files that a glTF or GLB file names and that are there."""
    header = read_gltf_file(path).header
    files = []
    for kind in ("buffers", "images") if with_images else ("buffers",):
        entries = header.get(kind, [])
        for entry in entries if isinstance(entries, list) else []:
            uri = entry.get("uri") if isinstance(entry, dict) else None
            if isinstance(uri, str) and not uri.startswith("data:"):
                files.append(named_file(path, uri))
    return [file for file in files if file is not None]


def named_file(path: Path, uri: str) -> Path | None:
    """Find the file of a relative URI, in the folder of a glTF file or below it."""
    return find_file(path.parent, [*usual_places(unquote(uri)), uri], within=path.parent)


def whole(value: Any) -> int:
    """Return a JSON number that is a whole one, zero or more; ValueError for all else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or value != int(value) or value < 0:
        raise ValueError(f"{shortened(str(value))} where a whole number is needed")
    return int(value)


def number(value: Any, least: float = -1e30, most: float = 1e30) -> float:
    """Return a JSON number within bounds; ValueError for all else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise ValueError(f"{shortened(str(value))} where a number is needed")
    return float(value)


def numbers(values: Any, count: int, least: float = -1e30, most: float = 1e30) -> list[float]:
    """Return a JSON list of `count` numbers within bounds; ValueError for all else."""
    if not isinstance(values, list) or len(values) != count:
        raise ValueError(f"{shortened(str(values))} where {count} numbers are needed")
    return [number(value, least, most) for value in values]


def extensions(entry: Json) -> dict[str, Json]:
    """Return what extensions say in an entry."""
    entries = entry.get("extensions", {})
    return {name: content for name, content in entries.items() if isinstance(content, dict)}


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    """JSON and binary chunk of a GLB file."""
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF":
        raise ValueError("the first bytes are not those of a GLB file")
    if version != 2:
        raise ValueError(f"its version is {version}, and 2 is read")
    if length > len(data):
        raise ValueError(f"it has {len(data)} bytes of {length}")
    chunks: list[tuple[bytes, bytes]] = []
    position = 12
    while position + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, position)
        if position + 8 + size > length:
            raise ValueError("a chunk ends behind the file")
        chunks.append((kind, data[position + 8 : position + 8 + size]))
        position += 8 + size
    if not chunks or chunks[0][0] != b"JSON":
        raise ValueError("its first chunk is no JSON")
    return chunks[0][1], next((content for kind, content in chunks[1:] if kind == b"BIN\0"), None)


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is no number of JSON")


def _unsupported(path: Path, names: Sequence[str]) -> InputError:
    remedies = dict.fromkeys(_REMEDIES.get(name, "Export it without that extension") for name in names)
    return InputError(
        str(path),
        f"needs the glTF extension {shortened(', '.join(names))[1:-1]}, which is not supported",
        "; ".join(remedies),
    )
