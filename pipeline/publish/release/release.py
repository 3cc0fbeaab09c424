"""A release of a data set: checked, described against the one before it, committed and tagged."""

import contextlib
import csv
import datetime
import io
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import FormatError, InputError
from objectfolder.export.files import MANIFEST, new_folder, write_json
from objectfolder.products.atomic import write_whole
from objectfolder.products.store import read_attributes
from pipeline.audit.comparison import Comparison
from pipeline.audit.contents import Contents
from pipeline.audit.findings import State
from pipeline.audit.git import GitRepository
from pipeline.audit.verification import verify
from pipeline.audit.versions import Version, made_nothing, read_version
from pipeline.dataset.counts import counted
from pipeline.dataset.lock_file import LOCK
from pipeline.dataset.partition_folders import FOLDER, data_sets, folders
from pipeline.dataset.selection import SELECTION, read_selection
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import FIDELITY, OBJECT_FILES
from pipeline.publish.cards.published_data_set import METRICS, PER_OBJECT, PUBLICATION, read_data_set
from pipeline.publish.data_set import REPORTS, write_cards
from pipeline.publish.release.changelog import object_versions, section, with_section
from pipeline.publish.release.zenodo import zenodo_text

NAME = re.compile(r"v(\d+)(?:\.(\d+))?(?:\.(\d+))?")
CHANGELOG, VERSIONS, ZENODO = f"{REPORTS}/CHANGELOG.md", f"{REPORTS}/object_versions.csv", ".zenodo.json"
CROISSANT = "croissant.json"
SENSES = ("vision", "audio", "touch")
CHANGES = (State.ADDED, State.REMOVED, State.RENAMED, State.CHANGED, State.MENDED)
Progress = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class ReleaseSummary:
    """A release that was tagged, the one before it, and how many objects are not as there."""

    version: str
    before: str
    objects: int
    changed: int
    changelog: str
    folder: str

    def __str__(self) -> str:
        since = f" since {self.before}" if self.before else ""
        count = counted(self.objects, "object")
        lines = [f"{self.version}: {count}, {self.changed} changed{since}; see {self.changelog}"]
        lines += [f"For Hugging Face: {self.folder}"] if self.folder else []
        return "\n".join([*lines, "Publish it:       dvc push && git push --follow-tags"])


def release(
    root: Path,
    name: str,
    stages: Sequence[Stage],
    *,
    day: datetime.date,
    since: str = "",
    remote: str = "",
    output: Path | None = None,
    progress: Progress = lambda _: None,
) -> ReleaseSummary:
    """Check the data set at `root`, write its cards and changelog, commit them and tag the commit.

    Nothing is written before all checks are passed, and nothing is pushed. Of a table in partitions, the
    release has all of them.

    Parameters
    ----------
    name
        ``v2`` or ``v2.1.0``.
    stages
        All stages.
    day
        Of the release.
    since
        The release before, a git revision; the nearest tag where it is empty.
    remote
        DVC remote for products of the release before that are not here.
    output
        A new folder for Hugging Face: its README is the data card.

    Raises
    ------
    InputError
        A name that is none or is taken; an `output` that exists; a work tree with changes, products that
        are not as the inputs ask for, a selection of objects, a damaged file, or an object without fidelity.
    """
    numbers = NAME.fullmatch(name)
    if numbers is None:
        raise InputError(name, "no name of a release", "Give v and a number, as v2 or v2.1.0.")
    if output and output.exists():
        raise InputError(str(output), "is there already", "Name a folder that does not exist yet.")
    with Contents(root, remote) as contents:
        progress("checking")
        _check_git(root, name)
        version = read_version(contents, stages, None)
        _check_products(root, contents, version, stages)
        before = since or _last_tag(root)
        progress("comparing")
        old = read_version(contents, stages, before) if before else made_nothing(stages)
        audit = Comparison(contents, old, read_version(contents, stages, "HEAD"), stages, False).audit()
        if audit.problems:
            raise InputError(before, f"cannot be compared ({audit.problems[0]})", "Fetch it: `dvc fetch`.")
        earlier = GitRepository(root).read(before, VERSIONS) if before else None
        object_files = dict(sorted(version.folders[OBJECT_FILES.folder].products.items()))
        digests = {key: content.md5 for key, content in object_files.items()}
    progress("writing")
    _state_publication(root, ".".join(number or "0" for number in numbers.groups()), day)
    figures = _write_figures_of_partitions(root)
    cards = [path.relative_to(root).as_posix() for path in write_cards(root, root / REPORTS)]
    card_paths = [path for own in folders(root) for path in write_cards(own, own / REPORTS)]
    changelog = (root / CHANGELOG).read_text("utf-8") if (root / CHANGELOG).is_file() else ""
    new = section(name, day.isoformat(), audit)
    texts = {
        CHANGELOG: with_section(changelog, new),
        VERSIONS: object_versions(name, digests, earlier),
        ZENODO: zenodo_text(read_data_set(root, root / REPORTS)),
    }
    for path, text in texts.items():
        write_whole(root / path, text)
    _record_cards(root, version)
    locks = [folder / LOCK for folder in data_sets(root)]
    _git(root, "add", "--", PUBLICATION, *figures, *cards, *texts, *map(str, [*card_paths, *locks]))
    _git(root, "commit", "--quiet", "--message", f"Release {name}")
    _git(root, "tag", "--annotate", "--cleanup=whitespace", "--message", new, name)
    if output:
        progress("writing the folder for Hugging Face")
        files = {key: content.where for key, content in object_files.items()}
        _write_hugging_face(root, output, files, [*cards, *texts])
    changed = sum(entry.state in CHANGES for entry in audit.objects)
    folder = str(output) if output else ""
    return ReleaseSummary(
        version=name, before=before, objects=len(digests), changed=changed, changelog=CHANGELOG, folder=folder
    )


def _check_git(root: Path, name: str) -> None:
    if _git(root, "tag", "--list", name):
        raise InputError(name, "this tag is there already", "Choose the next number.")
    changed = _git(root, "status", "--porcelain", "--untracked-files=no").splitlines()
    if changed:
        finding = f"{counted(len(changed), 'file')} not as in HEAD: {changed[0].split()[-1]}"
        raise InputError(str(root), finding, "Commit them, or `git stash`.")


def _check_products(root: Path, contents: Contents, version: Version, stages: Sequence[Stage]) -> None:
    """Raise where objects are selected, or products are not as asked for, damaged, or without fidelity."""
    from dvc.repo import Repo

    for own in data_sets(root):
        if read_selection(own):
            where = str((own / SELECTION).relative_to(root))
            finding = "objects are selected, and a release has all of the table"
            raise InputError(where, finding, "Run `make dataset` without ONLY, and commit.")
    for fault in verify(contents, version, stages).findings:
        raise InputError(fault.where, f"{fault.kind}: {fault.finding}", fault.remedy)
    with contextlib.chdir(root), Repo(str(root)) as repository:
        in_partitions = bool(folders(root))
        targets = [str(FOLDER) if in_partitions else "dvc.yaml"]
        if stale := repository.status(targets=targets, recursive=in_partitions):
            raise InputError(str(root), f"{min(stale)} is not up to date", "Run `dvc repro`, and commit.")
    for object_id in version.folders[OBJECT_FILES.folder].products:
        content = version.content(FIDELITY, object_id)
        try:
            attributes = read_attributes(root / content.where) if content else {}
            absent = [sense for sense in SENSES if not attributes.get(sense)]
        except (FileNotFoundError, FormatError):
            absent = list(SENSES)
        if absent:
            finding = f"states no fidelity of {', '.join(absent)}"
            raise InputError(object_id, finding, "Run `dvc repro`, and commit.")


def _state_publication(root: Path, number: str, day: datetime.date) -> None:
    """Write version and date to ``data/card.yaml``, whose other lines stay."""
    path = root / PUBLICATION
    lines = path.read_text("utf-8").splitlines() if path.is_file() else []
    rest = [line for line in lines if not re.match(r"(version|date):", line)]
    write_whole(path, "\n".join([*rest, f"version: {number}", f"date: {day.isoformat()}"]) + "\n")


def _write_figures_of_partitions(root: Path) -> list[str]:
    """Write the figures of all partitions where a data set has its own; return the names of the files."""
    tables = [path for own in folders(root) if (path := own / REPORTS / PER_OBJECT).is_file()]
    if not tables:
        return []
    rows = [row for table in tables for row in csv.DictReader(io.StringIO(table.read_text("utf-8")))]
    text = io.StringIO()
    columns = dict.fromkeys(column for row in rows for column in row)
    writer = csv.DictWriter(text, list(columns), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(sorted(rows, key=lambda row: row["id"]))
    (root / REPORTS).mkdir(exist_ok=True)
    write_whole(root / REPORTS / PER_OBJECT, text.getvalue())
    metrics = (root / FOLDER / METRICS).read_text("utf-8")
    write_whole(root / REPORTS / METRICS, metrics)
    return [f"{REPORTS}/{name}" for name in (PER_OBJECT, METRICS)]


def _record_cards(root: Path, version: Version) -> None:
    """Let each ``dvc.lock`` that has cards have them as they are now."""
    from dvc.repo import Repo

    # DVC would tell on standard output what it does.
    with contextlib.chdir(root), contextlib.redirect_stdout(sys.stderr), Repo(str(root)) as repository:
        for folder in (own.relative_to(root) for own in data_sets(root)):
            if (folder / REPORTS / CROISSANT).as_posix() in version.lock.outs:
                repository.commit(f"{folder / 'dvc.yaml'}:report", force=True)


def _last_tag(root: Path) -> str:
    """Return the nearest tag behind HEAD that is the name of a release; empty where there is none."""
    tags = _git(root, "tag", "--list", "v*", "--merged", "HEAD", "--sort=-creatordate").splitlines()
    return next((tag for tag in tags if NAME.fullmatch(tag)), "")


def _write_hugging_face(root: Path, output: Path, files: Mapping[str, str], texts: Sequence[str]) -> None:
    """Write a folder for Hugging Face of the Object Files, whose paths `files` has by object id."""
    with new_folder(output) as folder:
        figures = [f"{REPORTS}/{name}" for name in (PER_OBJECT, METRICS)]
        for name in (*texts, *figures, *files.values()):
            if (root / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(root / name, folder / name)
        (folder / REPORTS / "data_card.md").rename(folder / "README.md")
        write_json(folder / MANIFEST, {"format": "hugging_face", "objects": list(files)})


def _git(root: Path, *words: str) -> str:
    """Run git as its user has it set up; return what it prints."""
    process = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
    if process.returncode:
        raise InputError(f"git {words[0]}", (process.stderr or process.stdout).strip(), "See what git says.")
    return process.stdout.strip()
