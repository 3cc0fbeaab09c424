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
    source_object
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

    source_object: SourceObject
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
            "id": self.source_object.id,
            "outcome": self.outcome,
            "files": len(self.form.files),
            "bytes": self.bytes,
            "hashes_recorded": self.recorded,
            "mesh": str(self.mesh),
            "texture": str(self.texture) if self.texture else None,
            "licence": self.source_object.source.licence,
            "attribution": self.source_object.source.attribution,
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

    def missing(self, source_object: SourceObject) -> list[Download]:
        """Return what would be downloaded: nothing where all is there. Errors are those of `fetch`."""
        if self._local_form(source_object):
            return []
        try:
            return source_object.source.downloads(
                source_object.name, source_object.resolution, self._downloader
            )
        except (AbsentError, RefusedError) as problem:
            raise self._absent(source_object, problem) from problem

    def fetch(self, source_object: SourceObject) -> Fetched:
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
        target = source_object.folder(self._folder)
        partial = target.with_name(f".{target.name}.partial")
        with locked(target.with_name(f".{target.name}.lock")), writing(target):
            local_form = self._local_form(source_object)
            if local_form is not None:
                return Fetched(source_object, target, local_form, KEPT, 0)
            try:
                form, recorded = self._downloaded(source_object, partial)
                forms = read_forms(target) | {source_object.resolution: form}
                _copy_missing(target, partial, {name for entry in forms.values() for name in entry.files})
                write_forms(partial, source_object, forms)
                # Moved away before it is removed: a killed process leaves no half of an object.
                with tempfile.TemporaryDirectory(prefix=".", suffix=".old", dir=target.parent) as old:
                    if target.exists():
                        target.rename(Path(old, "replaced"))
                    partial.rename(target)
            except (AbsentError, RefusedError) as problem:
                raise self._absent(source_object, problem) from problem
            finally:
                shutil.rmtree(partial, ignore_errors=True)
        return Fetched(source_object, target, form, FETCHED, recorded)

    def fetch_all(
        self, source_ids: Sequence[str], resolutions: Resolutions
    ) -> Iterator[tuple[str, Fetched | ObjectFolderError]]:
        """Fetch the objects one by one; yield each id with the fetched object or its error."""
        unreachable: Counter[str] = Counter()
        for source_id in dict.fromkeys(source_ids):
            try:
                source_object = resolutions.source_object(source_id)
            except InputError as error:
                yield source_id, error
                continue
            source = source_object.source.id
            if unreachable[source] >= MOST_UNREACHABLE:
                finding = "not tried, for its source cannot be reached"
                yield source_id, InputError(source_id, finding, "Run the same command later.")
                continue
            try:
                yield source_id, self.fetch(source_object)
                unreachable[source] = 0
            except ObjectFolderError as error:
                unreachable[source] = unreachable[source] + 1 if isinstance(error, UnreachableError) else 0
                yield source_id, error

    def _local_form(self, source_object: SourceObject) -> Form | None:
        """Return the form that is there, if all of its files have the known hashes."""
        target = source_object.folder(self._folder)
        form = None if self._refresh else read_forms(target).get(source_object.resolution)
        if form is None:
            return None
        hashes = read_hashes(self._hashes)
        for name in form.files:
            path = target / name
            if not path.is_file() or hashes.get((source_object.id, name)) != content_of(path):
                return None
        return form

    def _downloaded(self, source_object: SourceObject, folder: Path) -> tuple[Form, int]:
        """Fill a folder; what is damaged or changed is downloaded once more before it is refused."""
        if not self._refresh:
            try:
                return self._laid_out(source_object, folder, anew=False)
            except (FormatError, ChangedError):
                pass
        return self._laid_out(source_object, folder, anew=True)

    def _laid_out(self, source_object: SourceObject, folder: Path, *, anew: bool) -> tuple[Form, int]:
        """Fill an empty folder as the source lays it out; return which file is what, and the new hashes."""
        shutil.rmtree(folder, ignore_errors=True)  # of a process that was killed
        folder.mkdir(parents=True)
        downloads = source_object.source.downloads(
            source_object.name, source_object.resolution, self._downloader
        )
        for entry in downloads:
            file = self._file(entry, anew=anew)
            if entry.top is None:
                place = folder / entry.path
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, place)
            elif not unpack(file, folder, top=entry.top, selects=source_object.source.selects):
                finding = f"holds none of the wanted files{f' in {entry.top}/' if entry.top else ''}"
                raise FormatError(file.name, finding, "The source has changed the layout of its archives.")
        paths = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
        if RECORD in paths:
            raise FormatError(source_object.id, f"has a file {RECORD!r} of its own", "Tell its source.")
        mesh, texture = source_object.source.mesh_and_texture(
            folder, source_object.name, source_object.resolution
        )
        form = Form(mesh, texture, tuple(str(entry.url) for entry in downloads), tuple(paths))
        contents = {path: content_of(folder / path) for path in paths}
        return form, record_hashes(
            self._hashes, source_object.id, contents, accept_changed=self._accept_changed
        )

    def _file(self, entry: Download, *, anew: bool) -> Path:
        """Return the path of a verified file: of this machine, or in the cache."""
        if isinstance(entry.url, Path):
            path = str(entry.url)
            if not entry.url.is_file():
                raise AbsentError(path, "no such file", "Check the path, and that its disk is mounted.")
            if difference := Expected(path, entry.md5, entry.size, LIMIT_BYTES).difference(entry.url):
                raise FormatError(path, difference, REMEDY)
            return entry.url
        if anew:
            self._downloader.forget(entry.url)
        return self._downloader.file(entry.url, md5=entry.md5, size=entry.size)

    def _absent(self, source_object: SourceObject, problem: InputError) -> InputError:
        """Return the error for an object that the source does not have, or refuses."""
        source = source_object.source
        try:
            names = self.names(source)
        except ObjectFolderError as unlisted:
            # Some servers refuse what they do not have; one that refuses its list, too, refuses everything.
            if isinstance(problem, RefusedError):
                return problem
            finding = f"not found, and the source's list cannot be fetched ({unlisted.finding})"
            return InputError(source_object.id, finding, f"Look for its name on {source.page}.")
        if source_object.name in names:
            remedy = source.absent.replace("NAME", source_object.name)
            return InputError(
                source_object.id, f"{source.title} has no {source_object.resolution} of it", remedy
            )
        by_folded = {name.casefold(): name for name in names}
        near = difflib.get_close_matches(source_object.name.casefold(), by_folded)
        suggestions = " or ".join(source.source_id(by_folded[name]) for name in near)
        remedy = f"Did you mean {suggestions}? " if near else ""
        remedy += f"`objectfolder fetch --list {source.id}` prints its {len(names)} names."
        return InputError(source_object.id, f"{source.title} has no such object", remedy)


def _copy_missing(source: Path, folder: Path, names: Iterable[str]) -> None:
    """Copy files of other resolutions beside those that were fetched."""
    for name in names:
        if not (folder / name).exists() and (source / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source / name, folder / name)
