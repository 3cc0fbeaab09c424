"""The container of an Object File: which metadata it has, and what of them is checked before any query."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.stored_values import (
    check_body,
    check_fidelity,
    check_material,
    check_words,
    number,
    numbers,
)
from objectfolder.products.tensor_file import REMEDY, TensorFile, read_tensor_file
from objectfolder.surface.codec import LARGEST_COORDINATE_M
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.network.sparse_grid import HALF_WIDTH

FORMAT = "objectfolder"
# Of files whose sight is learned as a whole, of those whose material is known, and of thin glass.
LEARNED, KNOWN, GLASS = VERSIONS = "3", "4", "5"
REQUIRED = (
    "object",
    "material",
    "body",
    "frame",
    "modes",
    "vision",
    "audio",
    "touch",
    "provenance",
    "fidelity",
)
# Of files that have it: measures of their convex parts, see `ObjectFile.collision`.
PRESENT_IN_SOME = ("collision",)


def read_container(path: Path | str) -> TensorFile:
    """Return the tensors and the metadata of an Object File, which is one by its format and version.

    Raises
    ------
    FormatError
        A folder, a truncated or foreign file, or an unknown version.
    FileNotFoundError
        No such file.
    """
    where = str(path)
    if Path(path).is_dir():
        files = sorted(Path(path).glob("*.safetensors"))
        remedy = f"Open a file in it, such as {files[0]}." if files else "Name an Object File (.safetensors)."
        raise FormatError(where, "a folder, not an Object File", remedy)
    content = read_tensor_file(path)
    if content.metadata.get("format") != FORMAT:
        raise FormatError(where, "a safetensors file, but not an Object File", "Build one from a mesh.")
    version = content.metadata.get("format_version")
    if version not in VERSIONS:
        raise FormatError(
            where,
            f"Object File of version {version}, this program reads {', '.join(VERSIONS)}",
            "Use the program that made it, or build it again.",
        )
    return content


def parse_description(metadata: Mapping[str, str]) -> dict[str, Any]:
    """Return the description that metadata hold as JSON."""
    stored = (*REQUIRED, *(key for key in PRESENT_IN_SOME if key in metadata))
    return {key: json.loads(metadata[key]) for key in stored}


def make_container(
    tensors: Mapping[str, np.ndarray], description: Mapping[str, Any], version: str
) -> TensorFile:
    """Return what `read_container` reads: tensors, and a description as metadata."""
    metadata: dict[str, Any] = {"format": FORMAT, "format_version": version}
    stored = (*REQUIRED, *(key for key in PRESENT_IN_SOME if key in description))
    metadata.update({key: json.dumps(description.get(key), sort_keys=True) for key in stored})
    return TensorFile(dict(tensors), metadata)


def check_description(description: Mapping[str, Any], surface: Surface) -> UnitFrame:
    """Check what is said of the object and its body; return the unit frame.

    Its box is the surface's but for what compression moves.

    Raises
    ------
    FormatError
        Values of another kind or out of range, or another box.
    """
    stored = description["frame"]
    numbers("frame.centre", stored["centre"], (3,), LARGEST_COORDINATE_M)
    number("frame.scale", stored["scale"], 1 / LARGEST_COORDINATE_M, LARGEST_COORDINATE_M)
    frame = UnitFrame.from_dict(dict(stored))
    box = frame.to_unit(surface.bounds)
    if np.abs(box).max() > HALF_WIDTH or np.ptp(box, axis=0).max() < HALF_WIDTH:
        raise FormatError("frame", "it is not that of the surface", REMEDY)
    check_words(description["object"])
    check_fidelity(description["fidelity"])
    check_body(description["body"])
    check_material(description["material"])
    return frame
