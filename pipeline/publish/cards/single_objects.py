"""Single objects of a published data set, without the rest of it."""

import difflib
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import FormatError, InputError, ObjectFolderError
from pipeline.audit.stores import Stores, md5_of
from pipeline.dataset.products import ProductKind, verify
from pipeline.dataset.stages import FIDELITY, MODES, OBJECT_FILES, OBJECTS, TOUCHES, VIEWS
from pipeline.publish.cards.published_revision import PublishedRevision, opened

JOBS = 4
KINDS = {kind.name: kind for kind in (OBJECT_FILES, OBJECTS, VIEWS, MODES, TOUCHES, FIDELITY)}
KEPT, FETCHED, FAILED = "already there", "fetched", "failed"


@dataclass(frozen=True)
class Got:
    """The result for one product: `FETCHED`, `KEPT`, or `FAILED` and an error."""

    object_id: str
    path: Path
    outcome: str
    bytes: int = 0
    error: ObjectFolderError | None = None


def get(
    repository: str,
    object_ids: Sequence[str],
    folder: Path,
    *,
    revision: str | None = None,
    stages: Sequence[str] = (),
    remote: str = "",
    jobs: int = JOBS,
    done: Callable[[Got], None] = lambda got: None,
    progress: Callable[[int], None] = lambda count: None,
) -> list[Got]:
    """Fetch products of objects; what is whole already is not fetched again.

    Parameters
    ----------
    repository, revision, remote
        As for `pipeline.publish.cards.published_revision.opened`.
    object_ids
        Which; none means all of the revision.
    folder
        Object Files come to ``<folder>/<id>.safetensors``. Where `stages` are named, products come under
        the paths they have in the repository, ``<folder>/data/views/<id>.zarr.zip``.
    stages
        Keys of `KINDS`.
    jobs
        Files at a time.
    done, progress
        Called as each file ends, and with the number of new bytes as they come; from one thread at a time.

    Returns
    -------
    list
        In the order of `stages` and `object_ids`. A failed one has its error; the others are not stopped.

    Raises
    ------
    InputError
        No such repository, revision, remote, stage or object; nothing is fetched then.
    """
    kinds = [_kind(stage) for stage in stages or (OBJECT_FILES.name,)]
    with opened(repository, revision, remote) as published:
        wanted = []
        for kind in kinds:
            known = published.products(kind)
            for object_id in list(dict.fromkeys(object_ids)) or sorted(known):
                path = folder / (kind.folder if stages else "") / f"{object_id}{kind.suffix}"
                wanted.append((object_id, _known(published, kind, known, object_id), path))
        lock = threading.Lock()

        def fetch(object_id: str, md5: str, path: Path) -> Got:
            count = 0

            def new_bytes(number: int) -> None:
                nonlocal count
                with lock:
                    count += number
                    progress(number)

            try:
                return Got(object_id, path, _fetched(published.stores, md5, path, new_bytes), count)
            except ObjectFolderError as error:
                return Got(object_id, path, FAILED, count, error)
            except OSError as error:  # of the folder it is written to: errors of stores are handled above
                finding = f"cannot be written ({error.strerror or error})"
                said = InputError(str(path), finding, "Check space and permissions of the folder.")
                return Got(object_id, path, FAILED, count, said)

        with ThreadPoolExecutor(max_workers=max(1, jobs)) as pool:
            futures = [pool.submit(fetch, *entry) for entry in wanted]
            for future in as_completed(futures):
                with lock:
                    done(future.result())
        return [future.result() for future in futures]


def known_ids(repository: str, *, revision: str | None = None, remote: str = "") -> list[str]:
    """Return the ids that have an Object File in a revision; see `get` for what is raised."""
    with opened(repository, revision, remote) as published:
        return sorted(published.products(OBJECT_FILES))


def _fetched(stores: Stores, md5: str, path: Path, progress: Callable[[int], None]) -> str:
    """Bring a product to `path`; until it is whole, it is ``.partial-<md5>-<name>`` beside it."""
    if path.is_file() and md5_of(path) == md5:
        return KEPT
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".partial-{md5}-{path.name}")
    stores.fetch(md5, partial, str(path), progress)
    try:
        verify(partial)
    except FormatError:
        partial.unlink()
        raise
    os.replace(partial, path)
    return FETCHED


def _kind(stage: str) -> ProductKind:
    if stage not in KINDS:
        raise InputError(stage, "no products of this name", f"There are {', '.join(KINDS)}.")
    return KINDS[stage]


def _known(published: PublishedRevision, kind: ProductKind, known: Mapping[str, str], object_id: str) -> str:
    if object_id in known:
        return known[object_id]
    near = difflib.get_close_matches(object_id, known, n=3, cutoff=0.4)
    remedy = (
        f"Near are {', '.join(near)}." if near else f"It has {len(known)}, as {', '.join(sorted(known)[:5])}."
    )
    raise InputError(published.name, f"no object {object_id!r} in {kind.folder}", remedy)
