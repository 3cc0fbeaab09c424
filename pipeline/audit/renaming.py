"""Renamed objects: read from the same files, each id in only one of the versions."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from typing import Any

from objectfolder.errors import ObjectFolderError
from objectfolder.provenance import canonical_json
from pipeline.audit.contents import Content
from pipeline.audit.descriptions import Description
from pipeline.audit.versions import Version
from pipeline.dataset.stages import OBJECTS

Describe = Callable[[Content], Description]


def renamed(old: Version, new: Version, describe: Describe) -> dict[str, str]:
    """Return former id to later id of objects that were renamed.

    Objects that went and objects that came are paired where they were read from the same files; of several
    with the same files, those with the same material first, then those with the same name.

    Parameters
    ----------
    old, new
        The versions.
    describe
        Reads what a product says.
    """
    gone, came = sorted(old.listed - new.listed), sorted(new.listed - old.listed)
    if not gone or not came:
        return {}
    by_files: dict[str, list[str]] = defaultdict(list)
    for object_id in gone:
        if key := _files(old, object_id, describe):
            by_files[key].append(object_id)
    wanted = {object_id: _files(new, object_id, describe) for object_id in came}
    pairs: dict[str, str] = {}
    for fields in (("material", "name"), ("material",), ()):
        for object_id in came:
            if object_id in pairs.values():
                continue
            row = new.rows.get(object_id, {})
            fitting = [
                one
                for one in by_files.get(wanted[object_id], ())
                if one not in pairs and all(_same(old.rows.get(one, {}), row, name) for name in fields)
            ]
            if fitting:
                pairs[fitting[0]] = object_id
    return pairs


def _files(version: Version, object_id: str, describe: Describe) -> str:
    """Return digests of the files an object is read from; empty where they are not known."""
    folder = version.folders.get(OBJECTS.folder)
    content = folder.products.get(object_id) if folder is not None else None
    if content is None:
        return ""
    try:
        inputs = describe(content).provenance.get("inputs")
        return canonical_json(inputs) if inputs else ""
    except (ObjectFolderError, TypeError, ValueError, RecursionError):
        return ""


def _same(old: Mapping[str, Any], new: Mapping[str, Any], field: str) -> bool:
    return bool(old.get(field) == new.get(field))
