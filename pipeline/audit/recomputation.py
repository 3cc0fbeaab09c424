"""Makes products of a version again in a scratch folder, and compares them with the stored ones."""

import random
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, InputError, ObjectFolderError
from objectfolder.products.provenance import code_identity, file_digest, package_versions
from pipeline.audit.contents import Content, Contents
from pipeline.audit.descriptions import mapping
from pipeline.audit.findings import sentences
from pipeline.audit.reproducibility import DIFFERENT, EQUAL, WITHIN, Arrays, compare, stored_tolerances
from pipeline.audit.versions import Version
from pipeline.dataset.differences import differences
from pipeline.dataset.lock_file import is_folder
from pipeline.dataset.parameters import ObjectsParameters
from pipeline.dataset.partition_folders import inside
from pipeline.dataset.products import ProductKind
from pipeline.dataset.records import MATERIALS, read_table
from pipeline.dataset.stage import Stage
from pipeline.dataset.task import Call, Request
from pipeline.sandbox.isolation import Child, ChildSettings, ProcessKilled

FAILED = "could not be made"
TABLE = "data/objects.csv"


@dataclass(frozen=True)
class Remade:
    """A product made again.

    Parameters
    ----------
    verdict
        `EQUAL`, `WITHIN`, `DIFFERENT` or `FAILED`.
    finding
        Why it failed, which arrays differ, that today's code is another.
    arrays
        Verdicts on its arrays and attributes.
    cpu_s
        CPU seconds that it took.
    """

    stage: str
    object_id: str
    verdict: str
    finding: str = ""
    arrays: Arrays = field(default_factory=Arrays)
    cpu_s: float = 0.0


def recompute(
    contents: Contents,
    version: Version,
    stages: Sequence[Stage],
    count: int,
    seed: int,
    started: Callable[[str, str], None] = lambda *_: None,
) -> list[Remade]:
    """Make `count` products again, drawn at random, and compare them within the tolerances that they carry.

    Each is made by its stage's own task, in a child process as in any run, from the parameters, the record
    and the seed that the product names, and the inputs that the version has. `started` is called with stage
    and object before each.

    Raises
    ------
    InputError
        The version has no product that could be made again.
    """
    candidates = [
        (stage, object_id)
        for stage in stages
        for object_id in sorted(version.rows)
        if all(version.content(kind, object_id) is not None for kind in stage.products)
    ]
    if count and not candidates:
        raise InputError(version.label, "has no product", "Run `dvc pull`, or name another version.")
    sample = random.Random(seed).sample(candidates, min(count, len(candidates)))
    results = []
    with tempfile.TemporaryDirectory(prefix="objectfolder-again-") as folder:
        bench = _Bench(Path(folder), contents, version)
        with Child(Path(folder), ChildSettings()) as child:
            for stage, object_id in sample:
                started(stage.name, object_id)
                try:
                    results.append(bench.remake(stage, object_id, child))
                except (ObjectFolderError, OSError, ProcessKilled) as error:
                    results.append(Remade(stage.name, object_id, FAILED, str(error)))
    return results


class _Bench:
    """A scratch folder with what a version has, laid out as in a work tree."""

    def __init__(self, root: Path, contents: Contents, version: Version) -> None:
        self._root, self._contents, self._version = root, contents, version

    def remake(self, stage: Stage, object_id: str, child: Child) -> Remade:
        """Make one product again."""
        contents = [self._content(kind, object_id) for kind in stage.products]
        descriptions = [self._contents.describe(content) for content in contents]
        parts = descriptions[-1].provenance
        code = code_identity(stage.task.partition(":")[0])
        code_changes = _changed(parts, code)
        request = Request(
            object_id,
            self._inputs(stage, object_id, parts),
            mapping(parts.get("parameters")),
            mapping(parts.get("record")),
            _seed(parts, contents[-1].where),
        )
        targets = tuple(stage.targets(self._root / "again", object_id))
        for target in targets:
            target.parent.mkdir(parents=True, exist_ok=True)
        # With today's code, not the version's: the child refuses code that differs from what it has loaded.
        call = Call(
            stage.name, stage.task, request, targets, descriptions[-1].fingerprint, {**parts, "code": code}
        )
        outcome = child.run(call)
        if outcome.failure is not None:
            finding = "; ".join([outcome.failure.error, *code_changes])
            return Remade(stage.name, object_id, FAILED, finding, cpu_s=outcome.cpu_s)
        arrays = Arrays()
        for content, target, description in zip(contents, targets, descriptions, strict=True):
            bounds, _ = stored_tolerances(stage.tolerances, description)
            arrays += Arrays.read(compare(self._place(content), target, bounds))
            target.unlink()
        verdict = next((candidate for candidate in (DIFFERENT, WITHIN) if arrays.count()[candidate]), EQUAL)
        finding = "; ".join(filter(None, [arrays.different(), *code_changes]))
        return Remade(stage.name, object_id, verdict, finding, arrays, outcome.cpu_s)

    def _content(self, kind: ProductKind, object_id: str) -> Content:
        content = self._version.content(kind, object_id)
        if content is None:
            raise InputError(kind.name, f"the version has no such product of {object_id}", "Run `dvc repro`.")
        return content

    def _inputs(self, stage: Stage, object_id: str, parts: Mapping[str, Any]) -> dict[str, Path]:
        """Return the products and the source files that a product was made from."""
        kinds = [product.kind for product in stage.inputs]
        paths = {kind.name: self._place(self._content(kind, object_id)) for kind in kinds}
        if stage.sources is None:
            return paths
        if object_id not in self._rows:
            finding = "the table of objects has no row of it here"
            raise InputError(object_id, finding, "Check that version out and recompute it there.")
        for role, path in stage.sources(self._rows[object_id]).items():
            if mapping(parts.get("inputs")).get(role) != file_digest(path):
                finding = f"the {role} differs from the one that the product was made from"
                raise InputError(str(path), finding, "Fetch the version's own files.")
            paths[role] = path
        return paths

    @cached_property
    def _rows(self) -> Mapping[str, Mapping[str, Any]]:
        """Rows of the version's table of objects, its source files beside it."""
        name = self._version.lock.table or TABLE
        if self._version.commit is None:
            return read_table(self._contents.root, ObjectsParameters(name)).rows
        for path in (name, MATERIALS.as_posix()):
            if path in self._version.texts:
                self._inside(path).write_bytes(self._version.texts[path])
        for path, folder in self._version.lock.outs.items():
            if is_folder(folder) and inside(path) not in self._version.folders:
                for inner, md5 in self._contents.folder(folder, path).items():
                    self._place(Content(md5, where=f"{path}/{inner}"))
        return read_table(self._root, ObjectsParameters(name)).rows

    def _place(self, content: Content) -> Path:
        """Return the path of a file of the version, put into the scratch folder."""
        path = self._inside(content.where)
        if not path.is_symlink() and not path.exists():
            self._contents.place(content, path)
        return path

    def _inside(self, where: str) -> Path:
        """Return a path in the scratch folder, whose parent exists."""
        path = self._root / where
        if not path.parent.resolve().is_relative_to(self._root.resolve()):
            raise InputError(
                where,
                "leads out of the data set",
                "Do not trust this dvc.lock: its paths must stay in the data set.",
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


def _seed(parts: Mapping[str, Any], where: str) -> int:
    """Return the seed that a product names; another seed would make another product."""
    seed = parts.get("seed")
    if type(seed) is not int:  # a truth value would pass as one
        raise FormatError(
            where, f"its seed {str(seed)[:60]!r} is not an integer", "See `objectfolder verify`."
        )
    return seed


def _changed(parts: Mapping[str, Any], code: Mapping[str, str]) -> list[str]:
    """Say where today's code and packages differ from those that a product names."""
    packages = mapping(parts.get("packages"))
    parts_then = {"code": mapping(parts.get("code")), "packages": packages}
    current = {"code": code, "packages": package_versions(packages)}
    return sentences(differences(parts_then, current))
