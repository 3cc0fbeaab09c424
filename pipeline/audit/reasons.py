"""Why a product differs between two versions, from the parts of its fingerprint, in users' words."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from objectfolder.products.provenance import fingerprint
from pipeline.audit.descriptions import Description
from pipeline.dataset.differences import SECTIONS, Reason, differences
from pipeline.dataset.stage import Stage

MESH, TEXTURE, SOURCE, MATERIAL, ROW, RECORD = (
    "mesh", "texture", "source file", "material", "material row", "record",
)  # fmt: skip
PARAMETER, CODE, PACKAGE, SEED, UPSTREAM = "parameter", "code", "package", "seed", "upstream"
TOLERANCE, BYTES, CORRUPTED, MISLABELLED, UNREADABLE = (
    "tolerance", "bytes", "corrupted", "fingerprint", "unreadable",
)  # fmt: skip
# What stands in a provenance beside the parts of the fingerprint.
BESIDE = ("fingerprints", "tolerances")
# Faults of a product, in place of differences in its parts.
DEFECTS = (CORRUPTED, MISLABELLED, UNREADABLE)


@dataclass(frozen=True)
class Circumstances:
    """What explains a difference and is in no fingerprint.

    Parameters
    ----------
    base_seeds
        Parameter ``seed`` of both versions, None where it is not known.
    materials
        Name of the object's material in both versions, empty where it is not known.
    tables
        Rows of the tables of materials of both versions.
    digests
        What the object's ``objects`` product says of geometry and texture in both versions; empty where it
        says nothing.
    renamed
        The two are of different ids.
    """

    base_seeds: tuple[Any, Any] = (None, None)
    materials: tuple[str, str] = ("", "")
    tables: tuple[Mapping[str, Mapping[str, str]], Mapping[str, Mapping[str, str]]] = ({}, {})
    digests: tuple[Mapping[str, Any], Mapping[str, Any]] = ({}, {})
    renamed: bool = False


def distinct(reasons: Iterable[Reason]) -> list[Reason]:
    """Return each reason once."""
    unique: list[Reason] = []
    for reason in reasons:
        if reason not in unique:
            unique.append(reason)
    return unique


def is_labelled_truly(description: Description) -> bool:
    """Whether a product's fingerprint is that of the parts it names."""
    parts = {section: part for section, part in description.provenance.items() if section not in BESIDE}
    try:
        return fingerprint(parts) == description.fingerprint
    except (TypeError, ValueError, RecursionError):
        return False


def why(stage: Stage, old: Description, new: Description, around: Circumstances) -> list[Reason]:
    """Return why two products of an object differ.

    Returns
    -------
    list of Reason
        At least one; `BYTES` where both were made from the same.
    """
    silent = [which for which, product in (("earlier", old), ("later", new)) if not product.provenance]
    if silent:
        finding = f"the {' and the '.join(silent)} one does not name what it was made from"
        return [Reason(MISLABELLED, note=finding)]
    reasons: list[Reason] = []
    # Most parts of most products are equal: only the others are walked through.
    sections = {key for key in SECTIONS if old.provenance.get(key) != new.provenance.get(key)}
    parts = [
        {key: product.provenance[key] for key in sections if key in product.provenance}
        for product in (old, new)
    ]
    try:
        for difference in differences(*parts):
            reasons += _explained(stage, difference, around)
    except RecursionError:
        reasons.append(Reason(MISLABELLED, note="its parts are too deep to be read"))
    reasons = _without_what_a_material_explains(distinct(reasons), around)
    if not is_labelled_truly(new):
        reasons.insert(0, Reason(MISLABELLED, note="it is not that of the parts the product names"))
    if not reasons:
        reasons += _tolerances(old.provenance.get("tolerances"), new.provenance.get("tolerances"))
    return reasons or [Reason(BYTES, note="made from the same, other bytes")]


def _explained(stage: Stage, difference: Reason, around: Circumstances) -> Iterator[Reason]:
    part, name, old, new = difference.kind, difference.name, difference.old, difference.new
    if part == "input":
        if stage.sources is None:
            kind, _, attribute = name.partition(".")
            attribute = attribute.removeprefix("digests.")
            yield Reason(UPSTREAM, f"{kind} ({attribute})" if attribute else kind)
        else:
            yield _source(name, old, new, around)
    elif part == "record":
        yield _record(name, old, new, around)
    elif part == "seed":
        before, after = around.base_seeds
        if before != after and None not in (before, after):
            yield Reason(SEED, "", before, after)
        elif around.renamed:
            yield Reason(SEED, "", note="drawn from the id")
        else:
            yield Reason(SEED, "", old, new)
    else:
        yield difference


def _source(role: str, old: Any, new: Any, around: Circumstances) -> Reason:
    """Name a source file by the properties of the object that it changed."""
    before, after = around.digests
    comparable = "geometry" in before and "geometry" in after
    geometry = comparable and before["geometry"] != after["geometry"]
    texture = comparable and before.get("texture") != after.get("texture")
    normals = "normals" in before and "normals" in after and before["normals"] != after["normals"]
    same = "geometry and texture are the same"
    note = (
        f"{'its normals' if normals else 'the file'} only: {same}"
        if comparable and not (geometry or texture)
        else ""
    )
    if role == "texture" or (role != "mesh" and texture):
        return Reason(TEXTURE, "", old, new, note if not texture else "")
    if role == "mesh" and texture and not geometry:
        return Reason(TEXTURE, "", old, new, "inside the file of the mesh, or where it is placed")
    if role == "mesh" or geometry:
        return Reason(MESH, "", old, new, note)
    return Reason(SOURCE, role, old, new, note)


def _record(name: str, old: Any, new: Any, around: Circumstances) -> Reason:
    section, _, field = name.partition(".")
    before, after = around.materials
    if name == "material.name":
        return Reason(MATERIAL, "", old, new)
    if section == "material":
        return Reason(ROW, f"{after}.{field}" if after else field, old, new)
    if name == "material_citation":
        return Reason(ROW, f"{after}.citation" if after else "citation", note="its text changed")
    if name == "loss_citation":
        return Reason(ROW, f"{after}.{name}" if after else name, note="its text changed")
    if name == "roughness_um":
        return Reason(ROW, f"{after}.{name}" if after else name, old, new)
    if section == "appearance":
        rows = [
            table.get(material, {}) for table, material in zip(around.tables, (before, after), strict=True)
        ]
        if all(_same(row.get(field), value) for row, value in zip(rows, (old, new), strict=True)):
            # The object's own row says nothing of it: its material does.
            if before != after:
                return Reason(MATERIAL, "", before, after)
            return Reason(ROW, f"{after}.{field}", old, new)
    return Reason(RECORD, name, old, new)


def _same(cell: str | None, value: Any) -> bool:
    try:
        return float(cell or "") == float(value)
    except (TypeError, ValueError):
        return False


def _without_what_a_material_explains(reasons: list[Reason], around: Circumstances) -> list[Reason]:
    """Drop reasons about cells of a material's row where the material itself changed."""
    if not any(reason.kind == MATERIAL for reason in reasons):
        before, after = around.materials
        # A stage that reads only the citation still sees another material.
        if before == after or not any(reason.kind == ROW for reason in reasons):
            return reasons
        reasons = [Reason(MATERIAL, "", before, after), *reasons]
    return [reason for reason in reasons if reason.kind != ROW]


def _tolerances(old: Any, new: Any) -> list[Reason]:
    if old == new:
        return []
    if not isinstance(old, Mapping) or not isinstance(new, Mapping):
        return [Reason(TOLERANCE, note="stored in one of the two only")]
    # As parts of a fingerprint, to be compared like them.
    sections = differences({"parameters": old}, {"parameters": new})
    return [Reason(TOLERANCE, difference.name, difference.old, difference.new) for difference in sections]
