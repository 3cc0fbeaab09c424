"""The manifest: what every product is, by content. It is the hinge of ``dvc.yaml``.

``data/products.csv`` has a line for every product, and for every object and stage that failed.
``data/manifest.json`` sums it up in a digest a stage; the stages of ``dvc.yaml`` that own the folders of
products hang on these. Both are functions of the products alone: they hold no times and no hosts.
"""

import contextlib
import csv
import io
import json
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, InputError
from objectfolder.products.atomic import write_whole
from objectfolder.products.provenance import fingerprint
from objectfolder.products.regular_file import read_regular, require_regular
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.stage import Stage
from pipeline.dataset.verified import Verified

MANIFEST = Path("data/manifest.json")
PRODUCTS = Path("data/products.csv")


@dataclass(frozen=True)
class Entry:
    """A product, or a failure in its place.

    Attributes
    ----------
    object, stage : which object, and the stage that makes the product
    path : from the root of the data set; empty for a failure
    fingerprint : of what it was made from
    md5 : of its bytes, the name under which DVC's cache has it
    bytes : its size
    failure : why there is no product
    """

    object: str
    stage: str
    path: str
    fingerprint: str
    md5: str = ""
    bytes: int = 0
    failure: str = ""


def list_products(root: Path, stages: Iterable[Stage], states: Verified) -> list[Entry]:
    """Return the products that lie in the folders of `stages`; files that cannot be read are left out."""
    entries = []
    for stage_name, kind in ((stage.name, kind) for stage in stages for kind in stage.products):
        names = {object_id: f"{kind.folder}/{object_id}{kind.suffix}" for object_id in kind.object_ids(root)}
        paths = [f"{root}{os.sep}{name}" for name in names.values()]  # a `Path` each would take as long
        with states.moment():
            states.md5s(paths)  # several at once
            for (object_id, name), path in zip(names.items(), paths, strict=True):
                with contextlib.suppress(FormatError, FileNotFoundError):
                    entries.append(Entry(object_id, stage_name, name, *states.identity(path)))
    return entries


def write_manifest(
    root: Path, stages: Sequence[Stage], failures: Iterable[FailedObject], states: Verified
) -> list[Entry]:
    """Write ``data/products.csv`` and ``data/manifest.json`` of what lies in the folders now; return it."""
    absences = (
        Entry(failure.object, failure.stage, "", failure.fingerprint, failure=failure.error)
        for failure in failures
    )
    entries = [*list_products(root, stages, states), *absences]
    _write_entries(root, entries)
    summary = {
        stage.name: _summary([entry for entry in entries if entry.stage == stage.name]) for stage in stages
    }
    write_whole(root / MANIFEST, json.dumps({"stages": summary}, indent=1) + "\n")
    return entries


def read_products(root: Path) -> dict[str, Entry]:
    """Return the products that the manifest lists, by path; none where there is no manifest.

    Raises
    ------
    InputError
        A damaged file.
    """
    try:
        require_regular(root / PRODUCTS)
        with (root / PRODUCTS).open(encoding="utf-8", newline="") as file:
            lines = [Entry(bytes=int(line.pop("bytes")), **line) for line in csv.DictReader(file)]
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, KeyError) as error:
        remedy = "Delete it, and run `dvc repro`."
        raise InputError(str(PRODUCTS), f"cannot be read ({error})", remedy) from error
    return {entry.path: entry for entry in lines if entry.path}


def read_summary(root: Path) -> dict[str, dict[str, Any]]:
    """Return what ``data/manifest.json`` says of each stage: digest, products, bytes, failed."""
    return dict(json.loads(read_regular(root / MANIFEST))["stages"])


def forget(root: Path, tasks: Collection[tuple[str, str]]) -> None:
    """Take the lines of stages and objects out of ``data/products.csv``: they are made anew now.

    If the run is killed, their new products are no damaged ones for the next run, and DVC sees that this
    one did not end.
    """
    if (root / PRODUCTS).is_file():
        with (root / PRODUCTS).open(encoding="utf-8", newline="") as file:
            header, *lines = csv.reader(file)
        place = [header.index(name) for name in ("stage", "object")]
        _write_lines(root, header, (line for line in lines if tuple(line[i] for i in place) not in tasks))


def is_listed(root: Path, stage: Stage, entries: Mapping[str, Entry], states: Verified) -> bool:
    """Whether the folders of a stage hold the products that the manifest lists, and no others."""
    paths_listed = {path for path, entry in entries.items() if entry.stage == stage.name}
    present = {
        kind.path(root, object_id).relative_to(root).as_posix()
        for kind in stage.products
        for object_id in kind.object_ids(root)
    }
    folders = all((root / kind.folder).is_dir() for kind in stage.products)
    if not folders or paths_listed != present:
        return False
    try:
        return all(states.md5(root / path) == entries[path].md5 for path in paths_listed)
    except FormatError:
        return False


def _summary(entries: Sequence[Entry]) -> dict[str, str | int]:
    """Return what the stages of ``dvc.yaml`` hang on."""
    with_path = [entry for entry in entries if entry.path]
    lines = [vars(entry) for entry in sorted(entries, key=_order)]
    return {
        "digest": fingerprint({"entries": lines})[:32],
        "products": len(with_path),
        "bytes": sum(entry.bytes for entry in with_path),
        "failed": len(entries) - len(with_path),
    }


def _write_entries(root: Path, entries: Iterable[Entry]) -> None:
    lines = (vars(entry).values() for entry in sorted(entries, key=_order))
    _write_lines(root, [field.name for field in fields(Entry)], lines)


def _write_lines(root: Path, header: Sequence[str], lines: Iterable[Iterable[object]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(lines)
    write_whole(root / PRODUCTS, text.getvalue())


def _order(entry: Entry) -> tuple[str, str, str]:
    return entry.stage, entry.object, entry.path
