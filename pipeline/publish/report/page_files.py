"""The files of an object's page: drawn in this process, or by a task on a worker."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import numpy as np

from objectfolder.errors import FormatError, ObjectFolderError
from objectfolder.products.tensor_file import TensorFile, read_tensor_file
from pipeline.dataset.archives import REMEDY
from pipeline.dataset.job import Job, Runner
from pipeline.dataset.products import STATE, TENSORS
from pipeline.dataset.stages import FIDELITY, OBJECT_FILES
from pipeline.dataset.task import Call, Failure, Request
from pipeline.dataset.verified import FINGERPRINT
from pipeline.publish.report.object_page import ObjectPage, page_name
from pipeline.publish.report.object_products import SUFFIXES, UNEXPECTED

MODULE = "pipeline.publish.report.page_files"
FOLDER = f"{STATE}/pages"  # files of pages on their way from workers, together in one for each page
FEW_PAGES = 16  # that one process draws before a cluster has started
EXPECTED_S, EXPECTED_BYTES = 1.0, 1 << 30  # of a page with its player

Files = dict[str, bytes]
RunnerFor = Callable[[int], AbstractContextManager[Runner]]


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
