"""Single objects of a published data set, without the rest of it.

DVC opens the repository (a path, or a URL whose git history is cloned to a temporary folder), finds its
revision, its outputs and its remote. The credentials are those of the user.
"""

import contextlib
import difflib
import os
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, InputError, ObjectFolderError
from pipeline.audit.opening import opened_clone, opened_folder
from pipeline.audit.stores import Stores
from pipeline.dataset.lock_file import LOCK, is_folder, read_lock
from pipeline.dataset.partition_folders import FOLDER, NAME, partition_number
from pipeline.dataset.products import ProductKind, md5_of, verify
from pipeline.dataset.records import SAFE_ID
from pipeline.dataset.stages import COLLISION, FIDELITY, MODES, OBJECT_FILES, OBJECTS, TOUCHES, VIEWS

KINDS = {kind.name: kind for kind in (OBJECT_FILES, OBJECTS, VIEWS, MODES, TOUCHES, COLLISION, FIDELITY)}
KEPT, FETCHED, FAILED = "already there", "fetched", "failed"
SCP_FORM = re.compile(r"[^/@]+@[^/:]+:")
MOST_LOCK_BYTES = 4 << 20
NOT_PUSHED = "Ask its publisher to `dvc push` this revision."


@dataclass(frozen=True)
class Got:
    """The result for one product: `FETCHED`, `KEPT`, or `FAILED` and an error."""

    object_id: str
    path: Path
    outcome: str
    error: ObjectFolderError | None = None


def get(
    repository: str,
    object_ids: Sequence[str],
    folder: Path,
    *,
    stages: Sequence[str] = (),
    remote: str = "",
    jobs: int = 4,
    progress: Callable[[int], None] = lambda count: None,
) -> Iterator[Got]:
    """Fetch products of objects; what is whole already is not fetched again.

    Parameters
    ----------
    repository, remote
        As for `opened`.
    object_ids
        Which; none means all of the revision.
    folder
        Object Files come to ``<folder>/<id>.safetensors``. Where `stages` are named, products come under
        the paths they have in the repository, ``<folder>/data/views/<id>.zarr.zip``.
    stages, jobs
        Keys of `KINDS`; files at a time.
    progress
        Called with the number of new bytes as they come, from any thread.

    Yields
    ------
    Got
        In the order of `stages` and `object_ids`. A failed one has its error; the others are not stopped.

    Raises
    ------
    InputError
        No such repository, revision, remote, stage or object; nothing is fetched then.
    """
    if unknown := set(stages).difference(KINDS):
        raise InputError(min(unknown), "no products of this name", f"There are {', '.join(KINDS)}.")

    with opened(repository, remote) as listing, ThreadPoolExecutor(max_workers=jobs) as pool:
        downloads = []
        for kind in (KINDS[stage] for stage in stages or (OBJECT_FILES.name,)):
            place = folder / kind.folder if stages else folder
            wish = listing.select(kind, object_ids)
            downloads += [(name, md5, place / f"{name}{kind.suffix}") for name, md5 in wish.items()]
        yield from pool.map(lambda product: _fetch(listing.stores, progress, *product), downloads)


@contextlib.contextmanager
def opened(repository: str, remote: str = "") -> Iterator["PublishedRevision"]:
    """Open a revision of a repository under DVC; a temporary clone is removed afterwards.

    Parameters
    ----------
    repository
        A path, or what ``git clone`` takes, with ``@REV`` for a branch, tag or commit; without it what
        lies in a path, and the default branch of a URL.
    remote
        Name of the DVC remote; the default one where it is empty.

    Raises
    ------
    InputError
        No repository there, none under DVC, one whose settings go beyond what is taken of them
        (`pipeline.audit.opening`), or no such revision or remote.
    """
    from dvc.exceptions import DvcException, NotDvcRepoError
    from dvc.repo import Repo
    from dvc.scm import RevError

    address, revision = split_revision(repository)
    with contextlib.ExitStack() as stack:
        try:
            try:
                opening = opened_folder(Repo.find_root(address), revision)
            except NotDvcRepoError:  # a URL, or a bare repository
                opening = opened_clone(address, revision)
            data_set = stack.enter_context(opening)
        except RevError as error:
            finding, remedy = f"no revision {revision!r}", "Name a branch, tag or commit of it."
            raise InputError(address, finding, remedy) from error
        except DvcException as error:
            cause = str(error.__cause__ or error).strip().replace("\n", " ")
            remedy = "Name the path or URL of a data set: a git repository under DVC."
            raise InputError(repository, f"cannot be opened ({cause})", remedy) from error
        yield PublishedRevision(repository, data_set, remote)


def split_revision(repository: str) -> tuple[str, str | None]:
    """Split ``REPO@REV``; an address with a user name, as ``git@host:repo.git``, has no revision in it."""
    before, at, after = repository.rpartition("@")
    if not at or not after or Path(repository).exists():
        return repository, None
    address = re.match(r"[a-z+]+://[^/]*/.", before) or SCP_FORM.match(before)
    if address or ("://" not in repository and ":" not in after):
        return before, after
    return repository, None


class PublishedRevision:
    """Which products a revision has, and the stores of their bytes; made by `opened`."""

    def __init__(self, name: str, repository: Any, remote: str) -> None:
        self.name = name
        self._repository = repository
        self.stores = Stores(repository, remote, NOT_PUSHED)
        _ = self.stores.remote

    def products(self, kind: ProductKind, object_ids: Sequence[str] = ()) -> dict[str, str]:
        """Return the MD5 of each product of a kind, by object id.

        Where products lie in partitions, only those that `object_ids` go to are looked at, all for none.

        Raises
        ------
        InputError
            A revision without this kind of product.
        NotHere
            No store gives the list of them.
        FormatError
            A list that is none, or a ``dvc.lock``.
        """
        places = self._partitions()
        if object_ids and places:
            numbers = {partition_number(object_id, len(places)) for object_id in object_ids}
            places = [places[number] for number in sorted(numbers)]
        digests: dict[str, str] = {}
        for place in places or [""]:
            folder = f"{place}{kind.folder}"
            digest = self._recorded(place, kind.folder)
            if not is_folder(digest):
                remedy = "Give a revision that has the data set made and committed."
                raise InputError(self.name, f"this revision has no {folder}", remedy)
            files = self.stores.folder(digest, f"{self.name}, {folder}")
            products = [name for name in files if name.endswith(kind.suffix)]
            digests |= {name.removesuffix(kind.suffix): files[name] for name in products}
        # The list is not trusted: a name in it must not lead out of a folder.
        return {object_id: md5 for object_id, md5 in digests.items() if SAFE_ID.fullmatch(object_id)}

    def _partitions(self) -> list[str]:
        """Return the folders of the partitions of a long table, each with a slash at its end."""
        fs = self._repository.fs
        folder = fs.join(self._repository.root_dir, str(FOLDER))
        entries = fs.ls(folder, detail=False) if fs.isdir(folder) else []
        return [f"{FOLDER}/{name}/" for name in sorted(map(fs.name, entries)) if NAME.fullmatch(name)]

    def _recorded(self, place: str, folder: str) -> str:
        """Return the MD5 of a folder by the file of ``dvc add`` beside it or by ``dvc.lock``; else nothing.

        DVC's own index would read all stages, and the files that imports among them name, such as a device.
        """
        fs, root = self._repository.fs, self._repository.root_dir
        for name, path in ((f"{folder}.dvc", Path(folder).name), (LOCK, folder)):
            name = f"{place}{name}"
            file = fs.join(root, *name.split("/"))
            if not fs.isfile(file):
                continue
            with fs.open(file, "rb") as stream:
                text = stream.read(MOST_LOCK_BYTES + 1)
            if len(text) > MOST_LOCK_BYTES:
                raise FormatError(f"{self.name}, {name}", f"larger than {MOST_LOCK_BYTES} bytes", NOT_PUSHED)
            md5 = read_lock(f"{self.name}, {name}", text).outs.get(path)
            if md5:
                return md5
        return ""

    def select(self, kind: ProductKind, object_ids: Sequence[str]) -> dict[str, str]:
        """Return `products` of these objects, or of all if none is named.

        Raises
        ------
        InputError
            An object without such a product; see `products` for others.
        """
        products = self.products(kind, object_ids)
        for object_id in object_ids:
            if object_id not in products:
                products = self.products(kind)
                near = difflib.get_close_matches(object_id, products, n=3, cutoff=0.4)
                count = f"It has {len(products)}, as {', '.join(sorted(products)[:5])}."
                remedy = f"Near are {', '.join(near)}." if near else count
                raise InputError(self.name, f"no object {object_id!r} in {kind.folder}", remedy)
        return {object_id: products[object_id] for object_id in object_ids or sorted(products)}


def _fetch(stores: Stores, progress: Callable[[int], None], object_id: str, md5: str, path: Path) -> Got:
    """Bring a product to `path`, once it is whole."""
    try:
        if path.is_file() and md5_of(path) == md5:
            return Got(object_id, path, KEPT)
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=path.parent) as folder:
            partial = Path(folder, path.name)
            stores.fetch(md5, partial, str(path), progress)
            verify(partial)
            os.replace(partial, path)
        return Got(object_id, path, FETCHED)
    except ObjectFolderError as error:
        return Got(object_id, path, FAILED, error)
    except OSError as error:  # of the folder it is written to: errors of stores are handled above
        finding = f"cannot be written ({error.strerror or error})"
        problem = InputError(str(path), finding, "Check space and permissions of the folder.")
        return Got(object_id, path, FAILED, problem)
