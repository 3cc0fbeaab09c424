"""The files of objects' pages: kept while they show what is known, else drawn here or on a worker."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import numpy as np

from objectfolder.errors import FormatError, ObjectFolderError
from objectfolder.products.atomic import write_whole
from objectfolder.products.tensor_file import TensorFile, read_tensor_file
from pipeline.dataset.archives import REMEDY
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.job import Job, Runner
from pipeline.dataset.products import STATE, TENSORS
from pipeline.dataset.stages import FIDELITY, OBJECT_FILES
from pipeline.dataset.task import Call, Failure, Request
from pipeline.dataset.verified import FINGERPRINT, without_collector
from pipeline.publish.report.object_page import PLAYER, ObjectPage, page_name, shown_fingerprint
from pipeline.publish.report.object_products import SUFFIXES, UNEXPECTED

MODULE = "pipeline.publish.report.page_files"
FOLDER = f"{STATE}/pages"  # files of pages on their way from workers, together in one for each page
FEW_PAGES = 16  # that one process draws before a cluster has started
EXPECTED_S, EXPECTED_BYTES = 1.0, 1 << 30  # of a page with its player

Files = dict[str, bytes]
RunnerFor = Callable[[int], AbstractContextManager[Runner]]


def write_pages(
    pages: Iterable[ObjectPage], folder: Path, cache: Path, runner_for: RunnerFor | None
) -> tuple[frozenset[str], list[FailedObject]]:
    """Write the files of pages, and remove others; return ids with a page, and why others have none."""
    page_ids, faults = set(), []
    file_names: set[str] = set()
    stale = []
    present = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    with without_collector():
        for page in pages:
            if names := _current_files(page, folder, present):
                file_names |= names
                page_ids.add(page.subject.object_id)
            else:
                stale.append(page)
    for page, files in draw_pages(stale, cache, runner_for):
        object_id = page.subject.object_id
        if isinstance(files, Failure):
            finding = f"{page.subject.stored_name}: {files.error}"
            faults.append(FailedObject(object_id, "report", finding, files.remedy))
            continue
        folder.mkdir(parents=True, exist_ok=True)
        *beside, (name, text) = files.items()
        for name_beside, content in beside:
            (folder / name_beside).write_bytes(content)
        write_whole(folder / name, text)  # the page, written last, says that all is there
        file_names |= files.keys()
        page_ids.add(object_id)
    if any(name.endswith(PLAYER) for name in file_names):
        from pipeline.publish.viewer.static import write_player_assets

        file_names |= write_player_assets(folder)
    for path in folder.iterdir() if folder.is_dir() else []:
        if path.name not in file_names and path.is_file():
            path.unlink()
    faults.sort(key=lambda failure: failure.object)
    return frozenset(page_ids), faults


def _current_files(page: ObjectPage, folder: Path, present: set[str]) -> set[str]:
    """Return the names of the files of a page, if all are `present` and show what is known; else none."""
    path = folder / page_name(page.subject.object_id)
    page_fingerprint, has_player = shown_fingerprint(path)
    if page_fingerprint != page.fingerprint:
        return set()
    names = {path.name, *map(page.beside, page.tile), *([page.player] if has_player else [])}
    return names if names <= present else set()


def draw_pages(
    pages: Sequence[ObjectPage], cache: Path, runner_for: RunnerFor | None
) -> Iterator[tuple[ObjectPage, Files | Failure]]:
    """Yield pages with their files by name, the page itself last, or why a page cannot be drawn.

    Parameters
    ----------
    pages
        In any order.
    cache
        Folder in which the data of players is kept.
    runner_for
        As `pipeline.run.converge` takes it. Without it pages are drawn in this process, whose instructions
        need not be those of tasks: samples of sounds may differ in the last bit.
    """
    if runner_for is None:
        for page in pages:
            try:
                yield page, draw(page, page.fingerprint, page.player, cache)
            except (ObjectFolderError, *UNEXPECTED) as error:
                yield page, Failure(page.subject.object_id, *words_of(error))
        return
    root, by_target = cache.parents[1], {}
    if not pages:
        return
    with runner_for(len(pages) if len(pages) > FEW_PAGES else 1) as runner:
        for page in pages:
            job = _job(page, root, cache)
            by_target[job.call.targets] = page
            runner.submit(job)
        for end in runner.finished(lambda busy, total: None):
            (target,) = end.job.call.targets
            page = by_target.pop((target,))
            if end.outcome.failure is not None:
                yield page, end.outcome.failure
                continue
            content = read_tensor_file(target)
            names = json.loads(content.metadata["names"])
            yield page, {name: content.tensors[name].tobytes() for name in names}
            target.unlink()


def draw(page: ObjectPage, fingerprint: str, player: str, cache: Path | None) -> Files:
    """Return the files of a page by name, the page itself last; raises what its products make it raise."""
    files, findings = {}, []
    object_id = page.subject.object_id
    if player:
        from pipeline.publish.viewer.static import player_script

        try:
            files[player] = player_script(page.products.path(OBJECT_FILES.name), object_id, cache)
        except (ObjectFolderError, *UNEXPECTED) as error:
            player = ""
            findings = [f"player: {words_of(error)[0]}"]
    text, beside = page.render(fingerprint, player, findings)
    files |= {page.beside(suffix): content for suffix, content in beside.items()}
    return {**files, page_name(object_id): text.encode()}


def draw_page(request: Request) -> TensorFile:
    """Draw a page on a worker: its files as arrays of bytes, and their names in order."""
    page: ObjectPage = request.record["page"]
    if FIDELITY.name in request.inputs:  # where this worker has it
        page = replace(page, data=request.inputs[FIDELITY.name].parents[1])
    cache = Path(request.parameters["cache"])
    folder = cache if cache.parent.is_dir() else None  # else this worker does not see the data folder
    has_object_file = page.products.path(OBJECT_FILES.name).is_file()
    player = request.parameters["player"] if has_object_file else ""
    files = draw(page, request.parameters["fingerprint"], player, folder)
    arrays = {name: np.frombuffer(content, np.uint8) for name, content in files.items()}
    return TensorFile(arrays, {"names": list(files)})


def words_of(error: Exception) -> tuple[str, str]:
    """Return finding and remedy."""
    if isinstance(error, ObjectFolderError):
        return error.finding, error.remedy
    return f"not what a report can show ({type(error).__name__}: {error})", REMEDY


def _job(page: ObjectPage, root: Path, cache: Path) -> Job:
    contents = {}
    paths = {kind: page.products.path(kind) for kind in SUFFIXES}
    assert page.verified is not None
    for kind, path in paths.items():
        try:
            contents[kind] = page.verified.attributes(path, (FINGERPRINT,))[FINGERPRINT]
        except (FileNotFoundError, FormatError):  # the page says so where the worker sees the folder
            continue
    object_id = page.subject.object_id
    parameters = {"cache": str(cache), "fingerprint": page.fingerprint, "player": page.player}
    record = {"page": replace(page, verified=None)}
    request = Request(object_id, {kind: paths[kind] for kind in contents}, parameters, record, 0)
    target = root / FOLDER / f"{page.subject.stored_name}{TENSORS}"
    parts = {"code": page.verified.code_identity(MODULE)}
    call = Call("report", f"{MODULE}:{draw_page.__name__}", request, (target,), page.fingerprint, parts)
    return Job(call, EXPECTED_S, EXPECTED_S, EXPECTED_BYTES, inputs=contents)
