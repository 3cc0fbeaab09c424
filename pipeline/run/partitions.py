"""Partitions: a table too long for one data set, as data sets in folders of one checkout.

A partition holds the objects whose ids hash into its range, so that an object stays where it is when others
come or go. It has all that a data set has: table, manifest, products, report, and a ``dvc.yaml`` made from
the checkout's. Parameters, materials and places are links to the checkout's. DVC takes them all as one graph:
``partitions/dvc.yaml`` writes the inputs of each, and sums up their reports. Only partitions whose inputs
changed run.
"""

import csv
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from objectfolder.products.atomic import write_whole
from pipeline.dataset.counts import columns
from pipeline.dataset.failures import FAILURES, RETRY
from pipeline.dataset.manifest import MANIFEST, read_products
from pipeline.dataset.parameters import PARAMETERS, read_parameters
from pipeline.dataset.partition_folders import FOLDER, folders, partition_number
from pipeline.dataset.records import MATERIALS, RECORDS
from pipeline.dataset.selection import SELECTION_FOLDER
from pipeline.dataset.stages import STAGES
from pipeline.run.code_digests import CODE, REPORT
from pipeline.run.source_digests import INPUTS, write_inputs
from pipeline.store.product_cache import ProductCache

MOST_OBJECTS = 10_000
LINKS = (PARAMETERS, "cluster", str(MATERIALS), "data/card.yaml")
STAGES_OF_ONE = ("products", *STAGES, REPORT, "failures")
PER_OBJECT = "reports/per_object.csv"
Text = dict[str, str]


@dataclass(frozen=True, kw_only=True)
class Partitions:
    """Names of partitions, and the objects that each is to hold; ``str`` words it."""

    objects: Mapping[str, int]

    def __str__(self) -> str:
        if not self.objects:
            return "The table is short enough for one data set. --objects takes fewer objects a partition."
        lines = columns([("partition", "objects"), *((name, str(n)) for name, n in self.objects.items())])
        return "\n".join([*lines, "", f"Make them: dvc repro -k -R {FOLDER}"])


def require_whole(root: Path) -> None:
    """Raise `InputError` where the products of a checkout lie in partitions."""
    if folders(root):
        remedy = f"Give --root {FOLDER}/000 for one of them; `dvc repro -k -R {FOLDER}` makes all."
        raise InputError(str(root), f"its products are in {FOLDER}/", remedy)


def partition(root: Path, most_objects: int = MOST_OBJECTS) -> Partitions:
    """Lay out partitions of at most about `most_objects` objects; as many as there are, or a power of two.

    Products that DVC has in its cache are taken over by the partition that their object goes to.

    Raises
    ------
    InputError
        The table cannot be used, lies outside the checkout, or leaves a partition without objects.
    """
    rows = _read_table(root)[1]
    before = folders(root)
    count = max(1 << (-(-len(rows) // most_objects) - 1).bit_length(), len(before))
    if count == 1 and not before:
        return Partitions(objects={})
    shares = _shares(rows, count)
    entries = [entry for folder in (root, *before) for entry in read_products(folder).values()]
    for number, name in enumerate(shares):
        folder = root / FOLDER / name
        _lay_out(root, folder)
        if count != len(before):
            ProductCache(folder).add(
                entry for entry in entries if partition_number(entry.object, count) == number
            )
    _write_yaml(root / FOLDER / "dvc.yaml", _common_stages(root, list(shares)))
    write_whole(root / FOLDER / ".gitignore", ".objectfolder/\nruns/\n")
    return Partitions(objects={name: len(share) for name, share in shares.items()})


def write_partition_inputs(root: Path) -> None:
    """Write the table, ``data/records.json`` and ``data/inputs.json`` of each partition.

    Raises
    ------
    InputError
        As of `partition`; there are no partitions.
    """
    names = [folder.name for folder in folders(root)]
    if not names:
        raise InputError(str(FOLDER), "there are no partitions", "Run `objectfolder partition`.")
    header, rows = _read_table(root)
    table = read_parameters(root / PARAMETERS).objects.table
    for name, share in _shares(rows, len(names)).items():
        own = root / FOLDER / name / table
        partition_rows = [_moved(row, (root / table).parent, own.parent) for row in share]
        text = io.StringIO()
        writer = csv.DictWriter(text, [*header, *({"mesh"} - {*header})], lineterminator="\n")
        writer.writeheader()
        writer.writerows(partition_rows)
        own.parent.mkdir(parents=True, exist_ok=True)
        write_whole(own, text.getvalue())
        write_inputs(root / FOLDER / name)


def _read_table(root: Path) -> tuple[list[str], list[Text]]:
    from pipeline.dataset.catalogue import read_rows  # here: every run asks for `folders`

    table = read_parameters(root / PARAMETERS).objects.table
    if os.path.isabs(table) or os.path.normpath(table).startswith(".."):
        remedy = "Copy it into data/, and choose the copy by `objectfolder select --table`."
        raise InputError(PARAMETERS, f"objects.table is {table}, outside the checkout", remedy)
    header, rows = read_rows(root / table)
    return header, [row for _, row in rows]


def _shares(rows: Sequence[Text], count: int) -> dict[str, list[Text]]:
    """Return the rows of each partition by its name."""
    shares: dict[str, list[Text]] = {f"{number:03}": [] for number in range(count)}
    for row in rows:
        shares[f"{partition_number(row['id'], count):03}"].append(row)
    if empty := [name for name, share in shares.items() if not share]:
        finding = f"no object of {len(rows)} goes to {', '.join(empty)} of {count} partitions"
        raise InputError("--objects", finding, f"Delete {FOLDER}/, and take more objects a partition.")
    return shares


def _moved(row: Text, before: Path, now: Path) -> Text:
    """Return a row whose files are named from another folder."""
    own = before if "mesh" in row else before / row["id"]
    names = {"mesh": row.get("mesh", "model.obj"), "texture": row.get("texture", "")}
    files = {
        column: os.path.relpath(own / name, now) if name and not os.path.isabs(name) else name
        for column, name in names.items()
        if column == "mesh" or column in row
    }
    return {**row, **files}


def _lay_out(root: Path, folder: Path) -> None:
    """Write what a partition has of its own before it is made, and the links to what it shares."""
    (folder / SELECTION_FOLDER).mkdir(parents=True, exist_ok=True)
    write_whole(folder / SELECTION_FOLDER / ".gitignore", "*\n!.gitignore\n")
    if not (folder / RETRY).exists():
        write_whole(folder / RETRY, "{}\n")
    for name in LINKS:
        link = folder / name
        if (root / name).exists() and not link.is_symlink():
            link.symlink_to(os.path.relpath(root / name, link.parent))
    content = _read_yaml(root / "dvc.yaml")["stages"]
    stages = {name: _stage_of_one(content[name], folder.name) for name in STAGES_OF_ONE if name in content}
    _write_yaml(folder / "dvc.yaml", {"stages": stages})


def _stage_of_one(stage: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a stage of the checkout as one of a partition: the same code, run for another folder."""
    up = {str(CODE): f"../../{CODE}"}
    parameters = [
        {up.get(path, path): keys for path, keys in entry.items()} if isinstance(entry, dict) else entry
        for entry in stage.get("params", ())
    ]
    own_stage = {**stage, "cmd": f"cd ../.. && {stage['cmd']} --root {FOLDER}/{name}"}
    return {**own_stage, "params": parameters} if parameters else own_stage


def _common_stages(root: Path, names: Sequence[str]) -> dict[str, Any]:
    """Return ``dvc.yaml`` of what is done for all partitions at once."""
    objects = read_parameters(root / PARAMETERS).objects
    meshes = "${objects.meshes}" if os.path.isabs(objects.meshes) else "../${objects.meshes}"
    dependencies = ("${objects.table}", str(RECORDS), str(INPUTS))
    products = (PER_OBJECT, str(FAILURES), str(MANIFEST))
    inputs = {
        "desc": "The table of each partition, and digests of its meshes and textures",
        "cmd": "cd .. && exec python -m pipeline.cli inputs --partitions",
        "deps": ["../${objects.table}", meshes, f"../{MATERIALS}"],
        "params": [{f"../{PARAMETERS}": ["objects.table"]}],
        "outs": [{f"{name}/{path}": {"cache": False}} for name in names for path in dependencies],
    }
    index = {
        "desc": "The reports of all partitions in a page",
        "cmd": "cd .. && exec python -m pipeline.cli report --partitions",
        "deps": [f"{name}/{path}" for name in names for path in products],
        "params": [{f"../{CODE}": [REPORT]}],
        "outs": [{"index.html": {"cache": False}}],
        "metrics": [{"metrics.json": {"cache": False}}],
    }
    return {"vars": [f"../{PARAMETERS}"], "stages": {"inputs": inputs, "index": index}}


def _read_yaml(path: Path) -> Any:
    from ruamel.yaml import YAML

    return YAML(typ="safe").load(path.read_text(encoding="utf-8"))


def _write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    from ruamel.yaml import YAML

    text = io.StringIO()
    yaml = YAML()
    yaml.width = 110
    yaml.dump(dict(content), text)
    write_whole(path, text.getvalue())
