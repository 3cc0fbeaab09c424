"""The products of one object, found by its id or by the path of one of them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from objectfolder.export.files import MANIFEST, Credit, write_json
from objectfolder.making.mesh.cleaning import clean
from objectfolder.making.mesh.readers.load import load_mesh
from objectfolder.products.store import read_attributes, read_product
from objectfolder.products.tensor_file import read_metadata
from objectfolder.surface.textured_mesh import TexturedMesh, textured_mesh_of
from pipeline.dataset.product_kinds import COLLISION, OBJECT_FILES, OBJECTS, VIEWS
from pipeline.dataset.records import RECORDS, read_records

KINDS = {"views": VIEWS, "object_file": OBJECT_FILES, "objects": OBJECTS, "collision": COLLISION}


@dataclass(frozen=True)
class ObjectProducts:
    """Paths of the products of one object; None for an absent one."""

    object_id: str
    views: Path | None = None
    object_file: Path | None = None
    objects: Path | None = None
    collision: Path | None = None
    mesh: Path | None = None
    record: Mapping[str, Any] | None = None

    def credit(self) -> Credit:
        """Return the credit from the data set's records, else from the Object File."""
        record = self.record
        if record is None and self.object_file is not None:
            record = json.loads(read_metadata(self.object_file).get("object", "null"))
        return Credit.of_record(self.object_id, record)

    def write_manifest(self, folder: Path, kind: str, description: Mapping[str, Any]) -> None:
        """Write the manifest and the attribution of an export."""
        credit = self.credit()
        write_json(folder / MANIFEST, {"format": kind, "object": credit.to_dict(), **description})
        (folder / "ATTRIBUTION.txt").write_text(credit.to_text(), encoding="utf-8")

    def source_mesh(self) -> TexturedMesh:
        """Return the mesh that was rendered.

        Raises
        ------
        InputError
            It is not there.
        """
        if self.objects is not None:
            return textured_mesh_of(read_product(self.objects))
        if self.mesh is not None:
            return clean(load_mesh(self.mesh), str(self.mesh))[0]
        remedy = "Name it by id with --root, or give a product of objects; or export the stored surface."
        raise InputError(self.object_id, "its source mesh is not here", remedy)


def find_products(name: str, root: Path) -> ObjectProducts:
    """Find the products of an object named by its id or by the path of one of them.

    Other products that lie in the same data set are found, too.

    Raises
    ------
    InputError
        Nothing of that name.
    """
    path = Path(name)
    paths: dict[str, Any] = {}
    object_id = name
    if path.is_file():
        kind = _kind(path)
        if kind == "mesh":
            return ObjectProducts(path.stem, mesh=path)
        object_id = path.name.removesuffix(KINDS[kind].suffix)
        paths[kind] = path
        if path.parent.name != KINDS[kind].name:
            return ObjectProducts(object_id, **paths)
        root = path.resolve().parents[2]
    elif path.suffix or path.parent != Path("."):
        raise InputError(name, "no such file", "Check the path.")
    for kind, product_kind in KINDS.items():
        beside = product_kind.path(root, object_id)
        if beside.is_file():
            paths.setdefault(kind, beside)
    if not paths:
        ids = VIEWS.object_ids(root)
        remedy = f"Use one of {', '.join(ids)}." if ids else "Give the data set by --root, or a path."
        raise InputError(object_id, f"no product of it in {root / 'data'}", remedy)
    record = read_records(root).rows.get(object_id) if (root / RECORDS).is_file() else None
    return ObjectProducts(object_id, **paths, record=record)


def _kind(path: Path) -> str:
    """Return the kind of a file, from its suffix or the attributes of a product."""
    if path.name.endswith(OBJECT_FILES.suffix):
        return "object_file"
    if not path.name.endswith(VIEWS.suffix):
        return "mesh"
    attributes = read_attributes(path)
    if "camera_radius" in attributes and "light_power_w" in attributes:
        return "views"
    if "digests" in attributes:
        return "objects"
    raise InputError(str(path), "is a product of neither views nor objects", "Give one of those.")
