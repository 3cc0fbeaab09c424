"""The JSON of glTF files, for what else they say of an object."""

from pathlib import Path

from objectfolder.geometry.gltf_file import KINDS, Json, read_gltf_file

FORMATS = KINDS


def gltf_header(path: Path) -> Json:
    """Return the JSON of a glTF or GLB file; see `gltf_file.read_gltf_file`."""
    return read_gltf_file(path).header
