"""`source.json` of a fetched object's folder: which file is what, and where from."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter

from objectfolder.products.atomic import atomic_write
from pipeline.intake.sources.source import SourceObject

RECORD = "source.json"


@dataclass(frozen=True)
class Form:
    """An object as it was fetched at one resolution.

    Parameters
    ----------
    mesh, texture
        Paths in the object's folder; a texture of None is named by the mesh.
    addresses
        Of all that was fetched for it.
    files
        Paths in the object's folder; `recorded_hashes` has their contents.
    """

    mesh: str
    texture: str | None
    addresses: tuple[str, ...]
    files: tuple[str, ...]


def write_forms(folder: Path, asked: SourceObject, forms: Mapping[str, Form]) -> None:
    """Write `source.json` of an object's folder; its mesh and texture are those that were asked for."""
    source, form = asked.source, forms[asked.resolution]
    said = {
        "source_id": asked.id,
        "source": source.title,
        "address": source.object_page(asked.name),
        "licence": source.licence,
        "attribution": source.attribution,
        "mesh": form.mesh,
        "texture": form.texture,
        "resolution": asked.resolution,
        "resolutions": {key: asdict(value) for key, value in sorted(forms.items())},
    }
    with atomic_write(folder / RECORD) as file:
        file.write((json.dumps(said, indent=1, ensure_ascii=False) + "\n").encode())


def read_forms(folder: Path) -> dict[str, Form]:
    """Return the forms by resolution of `source.json`; none where it is absent or no such record."""
    try:
        said = json.loads((folder / RECORD).read_bytes())
        return TypeAdapter(dict[str, Form]).validate_python(said["resolutions"])
    except (OSError, ValueError, KeyError, TypeError):
        return {}
