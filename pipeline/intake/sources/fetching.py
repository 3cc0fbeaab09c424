"""Objects from their sources to their folders: downloaded, unpacked, compared with what is known."""

import difflib
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import FormatError, InputError, ObjectFolderError
from pipeline.intake.disk import locked, writing
from pipeline.intake.sources.download import LIMIT_BYTES, REMEDY, Downloader, Expected
from pipeline.intake.sources.http_client import AbsentError, RefusedError, UnreachableError
from pipeline.intake.sources.recorded_hashes import (
    RECORD,
    ChangedError,
    Form,
    content_of,
    read_forms,
    read_hashes,
    record_hashes,
    write_forms,
)
from pipeline.intake.sources.registry import Resolutions
from pipeline.intake.sources.source import Download, Source, SourceObject
from pipeline.intake.sources.unpacking import unpack

FETCHED, KEPT = "fetched", "already there"
MOST_UNREACHABLE = 2  # objects of a source in a row, after which its other objects are not asked for


@dataclass(frozen=True)
class Fetched:
    """An object in its folder.

    Parameters
    ----------
    asked
        What was asked for.
    folder
        Where it is.
    form
        The form that was asked for.
    outcome
        `FETCHED` or `KEPT`.
    recorded
        Number of hashes that were not known before.
    """

    asked: SourceObject
    folder: Path
    form: Form
    outcome: str
    recorded: int

    @property
    def mesh(self) -> Path:
        """Its mesh."""
        return self.folder / self.form.mesh

    @property
    def texture(self) -> Path | None:
        """Its base colour image; None where the mesh names what it needs."""
        return None if self.form.texture is None else self.folder / self.form.texture

    @property
    def bytes(self) -> int:
        """Of its files."""
        return sum((self.folder / name).stat().st_size for name in self.form.files)

    def figures(self) -> dict[str, str | int | None]:
        """Return what it is and where, for JSON."""
        return {
            "id": self.asked.id,
            "outcome": self.outcome,
            "files": len(self.form.files),
            "bytes": self.bytes,
            "hashes_recorded": self.recorded,
            "mesh": str(self.mesh),
            "texture": str(self.texture) if self.texture else None,
            "licence": self.asked.source.licence,
            "attribution": self.asked.source.attribution,
        }


class Fetcher:
    """Fetches objects of any source into one folder.

    Parameters
    ----------
    folder
        Of all; an object's is ``<folder>/<source>/<name>``.
    downloader
        Fetches files and documents.
    hashes
        Table of what is known of files, which is added to.
    refresh
        Ask the source anew for objects that are here and whole.
    accept_changed
        Likewise, and take and record content that is another than is known.
    """

    def __init__(
        self,
        folder: Path,
        downloader: Downloader,
        hashes: Path,
        *,
        refresh: bool = False,
        accept_changed: bool = False,
    ) -> None:
        self._folder = folder
        self._downloader = downloader
        self._hashes = hashes
        self._refresh = refresh or accept_changed
        self._accept_changed = accept_changed
        self._names: dict[str, list[str]] = {}

    def names(self, source: Source) -> list[str]:
        """Return all names that a source lists, asked for once."""
        if source.id not in self._names:
            self._names[source.id] = source.names(self._downloader)
        return self._names[source.id]

    def missing(self, asked: SourceObject) -> list[Download]:
        """Return what would be downloaded: nothing where all is there. Errors are those of `fetch`."""
        if self._kept(asked):
            return []
        try:
            return asked.source.downloads(asked.name, asked.resolution, self._downloader)
        except (AbsentError, RefusedError) as problem:
            raise self._absent(asked, problem) from problem

    def fetch(self, asked: SourceObject) -> Fetched:
        """Fetch one object, or find that it is there and whole.

        Raises
        ------
        InputError
            No such object or resolution, its source cannot be reached, or the folder not written.
        ChangedError
            A file is another than is recorded of it.
        FormatError
            What was downloaded is damaged, or laid out as the source does not lay it out.
        """
        target = asked.folder(self._folder)
        partial = target.with_name(f".{target.name}.partial")
        with locked(target.with_name(f".{target.name}.lock")), writing(target):
            kept = self._kept(asked)
            if kept is not None:
                return Fetched(asked, target, kept, KEPT, 0)
            try:
                form, recorded = self._downloaded(asked, partial)
                forms = read_forms(target) | {asked.resolution: form}
                _copy_missing(target, partial, {name for one in forms.values() for name in one.files})
                write_forms(partial, asked, forms)
                # Moved away before it is removed: a killed process leaves no half of an object.
                with tempfile.TemporaryDirectory(prefix=".", suffix=".old", dir=target.parent) as old:
                    if target.exists():
                        target.rename(Path(old, "replaced"))
                    partial.rename(target)
            except (AbsentError, RefusedError) as problem:
                raise self._absent(asked, problem) from problem
            finally:
                shutil.rmtree(partial, ignore_errors=True)
        return Fetched(asked, target, form, FETCHED, recorded)

    def fetch_all(
        self, source_ids: Sequence[str], resolutions: Resolutions
    ) -> Iterator[tuple[str, Fetched | ObjectFolderError]]:
        """Fetch one object after another, each once; yield each id with the object or why there is none."""
        unreachable: Counter[str] = Counter()
        for source_id in dict.fromkeys(source_ids):
            try:
                asked = resolutions.asked(source_id)
            except InputError as error:
                yield source_id, error
                continue
            source = asked.source.id
            if unreachable[source] >= MOST_UNREACHABLE:
                finding = "not tried, for its source cannot be reached"
                yield source_id, InputError(source_id, finding, "Run the same command later.")
                continue
            try:
                yield source_id, self.fetch(asked)
                unreachable[source] = 0
            except ObjectFolderError as error:
                unreachable[source] = unreachable[source] + 1 if isinstance(error, UnreachableError) else 0
                yield source_id, error

    def _kept(self, asked: SourceObject) -> Form | None:
        """Return the form that is there, if all of its files have the known hashes."""
        target = asked.folder(self._folder)
        form = None if self._refresh else read_forms(target).get(asked.resolution)
        if form is None:
            return None
        known = read_hashes(self._hashes)
        for name in form.files:
            path = target / name
            if not path.is_file() or known.get((asked.id, name)) != content_of(path):
                return None
        return form

    def _downloaded(self, asked: SourceObject, folder: Path) -> tuple[Form, int]:
        """Fill a folder; what is damaged or changed is downloaded once more before it is refused."""
        if not self._refresh:
            try:
                return self._laid_out(asked, folder, anew=False)
            except (FormatError, ChangedError):
                pass
        return self._laid_out(asked, folder, anew=True)

    def _laid_out(self, asked: SourceObject, folder: Path, *, anew: bool) -> tuple[Form, int]:
        """Fill an empty folder as the source lays it out; return which file is what, and the new hashes."""
        shutil.rmtree(folder, ignore_errors=True)  # of a process that was killed
        folder.mkdir(parents=True)
        listed = asked.source.downloads(asked.name, asked.resolution, self._downloader)
        for entry in listed:
            file = self._file(entry, anew=anew)
            if entry.top is None:
                place = folder / entry.path
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, place)
            elif not unpack(file, folder, top=entry.top, wanted=asked.source.wanted):
                finding = f"holds none of the wanted files{f' in {entry.top}/' if entry.top else ''}"
                raise FormatError(file.name, finding, "Its source lays it out differently than it did.")
        paths = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
        if RECORD in paths:
            raise FormatError(asked.id, f"has a file {RECORD!r} of its own", "Tell its source.")
        mesh, texture = asked.source.mesh_and_texture(folder, asked.name, asked.resolution)
        form = Form(mesh, texture, tuple(str(entry.url) for entry in listed), tuple(paths))
        contents = {path: content_of(folder / path) for path in paths}
        return form, record_hashes(self._hashes, asked.id, contents, accept_changed=self._accept_changed)

    def _file(self, entry: Download, *, anew: bool) -> Path:
        """Return the path of a verified file: of this machine, or in the cache."""
        if isinstance(entry.url, Path):
            path = str(entry.url)
            if not entry.url.is_file():
                raise AbsentError(path, "no such file", "See whether its disk is there.")
            if difference := Expected(path, entry.md5, entry.size, LIMIT_BYTES).difference(entry.url):
                raise FormatError(path, difference, REMEDY)
            return entry.url
        if anew:
            self._downloader.forget(entry.url)
        return self._downloader.file(entry.url, md5=entry.md5, size=entry.size)

    def _absent(self, asked: SourceObject, problem: InputError) -> InputError:
        """Return the error for an object that the source does not have, or refuses."""
        source = asked.source
        try:
            names = self.names(source)
        except ObjectFolderError as unlisted:
            # Some servers refuse what they do not have; one that refuses its list, too, refuses everything.
            if isinstance(problem, RefusedError):
                return problem
            finding = f"not there, and the source's list cannot be had ({unlisted.finding})"
            return InputError(asked.id, finding, f"Look for its name on {source.page}.")
        if asked.name in names:
            remedy = source.absent.replace("NAME", asked.name)
            return InputError(asked.id, f"{source.title} has no {asked.resolution} of it", remedy)
        by_folded = {name.casefold(): name for name in names}
        near = difflib.get_close_matches(asked.name.casefold(), by_folded)
        meant = " or ".join(source.source_id(by_folded[name]) for name in near)
        remedy = f"Did you mean {meant}? " if near else ""
        remedy += f"`objectfolder fetch --list {source.id}` prints its {len(names)} names."
        return InputError(asked.id, f"{source.title} has no such object", remedy)


def _copy_missing(source: Path, folder: Path, names: Iterable[str]) -> None:
    """Copy files of other resolutions beside those that were fetched."""
    for name in names:
        if not (folder / name).exists() and (source / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source / name, folder / name)
