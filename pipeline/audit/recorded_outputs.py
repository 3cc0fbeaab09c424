"""The files and figures of a run that differ from those committed to git, and why, in one line."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from pipeline.audit.committed_figures import changes_of_means
from pipeline.audit.fidelity import worst_first
from pipeline.audit.findings import value
from pipeline.audit.git import GitRepository
from pipeline.audit.versions import METRICS, PER_OBJECT
from pipeline.dataset.counts import counted
from pipeline.dataset.lock_file import LOCK, Lock, is_folder, read_lock

NAMED = 3  # figures and causes, before the rest are counted
ROUNDING = (
    "same code, parameters and inputs, so another processor or another build of a package rounds otherwise"
)
TIMES = "CPU seconds"
MEASURED = "times are of the machine and the run"


def difference(root: Path) -> str:
    """Return in one line how what a run recorded differs from HEAD, and why; empty if it does not.

    Parameters
    ----------
    root
        Root of the data set. Where it has no commit, or no ``dvc.lock``, there is nothing to say.

    Raises
    ------
    FormatError
        A ``dvc.lock`` or a ``metrics.json`` that is none.
    """
    try:
        git = GitRepository(root)
        before = git.read("HEAD", LOCK)
    except InputError:  # no repository, or no commit
        return ""
    if before is None or not (root / LOCK).is_file():
        return ""
    old, new = read_lock(f"{LOCK} of HEAD", before), read_lock(LOCK, (root / LOCK).read_bytes())
    paths = [LOCK, *(path for path, md5 in new.outs.items() if not is_folder(md5))]
    recorded = {path: text for path in paths if (text := git.read("HEAD", path)) is not None}
    lying = {path: (root / path).read_bytes() for path in recorded if (root / path).is_file()}
    changed = [path for path in recorded if recorded[path] != lying.get(path)]
    if not changed:
        return ""
    figures = _figures(recorded, lying)
    if _times(recorded.get(PER_OBJECT)) != _times(lying.get(PER_OBJECT)):
        figures.append(TIMES)
    what = f": {'; '.join(figures)}" if figures else ""
    files = "1 recorded file differs" if len(changed) == 1 else f"{len(changed)} recorded files differ"
    return f"{files} from HEAD ({_named(changed)}){what}. Why: {_causes(old, new)}."


def _figures(old: Mapping[str, bytes], new: Mapping[str, bytes]) -> list[str]:
    """Return the means of fidelity that differ, those first that a person would notice."""
    changes = changes_of_means(old.get(METRICS), new.get(METRICS))
    ordered = sorted(worst_first(changes), key=lambda change: -abs(change.weight))
    texts: list[str] = []
    for change in ordered:
        before, after = value(change.measure, change.before), value(change.measure, change.after)
        if before != after:
            texts.append(f"{change.measure} {before} -> {after}")
    rest = len(ordered) - len(texts[:NAMED])
    return texts[:NAMED] + [counted(rest, "more mean")] * bool(rest)


def _times(table: bytes | None) -> list[list[str]]:
    """Return the columns of CPU seconds of a table of objects."""
    rows = csv.DictReader(io.StringIO((table or b"").decode(errors="replace")))
    return [[cell for name, cell in row.items() if str(name).startswith("cpu_seconds.")] for row in rows]


def _causes(old: Lock, new: Lock) -> str:
    dependencies = _differing(old.deps, new.deps) - old.outs.keys() - new.outs.keys()
    parameters = _differing(old.parameters, new.parameters)
    causes = []
    if dependencies:
        causes.append(f"{_named(sorted(dependencies))} changed after they were recorded")
    if parameters:
        causes.append(f"other parameters ({_named(sorted(parameters))})")
    if not causes:
        products = [path for path in new.outs if path.startswith("data/")]
        same = all(old.outs.get(path) == new.outs[path] for path in products)
        causes = [MEASURED if same else ROUNDING]
    return " and ".join(causes)


def _differing(old: Mapping[str, Mapping[str, Any]], new: Mapping[str, Mapping[str, Any]]) -> set[str]:
    """Return the names whose values differ in any stage."""
    stages = [(old.get(stage, {}), new.get(stage, {})) for stage in {**old, **new}]
    return {
        name
        for before, after in stages
        for name in {**before, **after}
        if before.get(name) != after.get(name)
    }


def _named(texts: list[str]) -> str:
    rest = len(texts) - NAMED
    return ", ".join(texts) if rest <= 1 else f"{', '.join(texts[:NAMED])} and {rest} more"
