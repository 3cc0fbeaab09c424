"""Make products and report of a repository of `bench.factory.overhead_repository`, run in its folder.

Every kind is made once by its task body and written as any product is; the others get the arrays of the
first and attributes of their own, for packing arrays of thousands of products is not what is measured. Nor
is drawing their pages: the first is drawn, the others are it under their names and fingerprints.
"""

import importlib
import json
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.products.store import ZIP_DATE, Product, write_product
from objectfolder.products.tensor_file import TensorFile, to_bytes
from pipeline.dataset.job import Finished, Job
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.records import read_table, write_records
from pipeline.dataset.stages import FIDELITY, STAGES
from pipeline.dataset.task import Call, Outcome
from pipeline.publish.data_set import REPORTS
from pipeline.publish.report.object_page import page_name
from pipeline.publish.report.page_files import draw_page
from pipeline.publish.report.report import write_report
from pipeline.run.converge import converge
from pipeline.run.costs import costs_path

GROUP = "zarr.json"


class Fabricating:
    """Makes products at once, in this process."""

    def __init__(self) -> None:
        self._jobs: list[Job] = []
        self._entries: dict[str, dict[str, bytes]] = {}

    def submit(self, job: Job) -> None:
        """Accept a job."""
        self._jobs.append(job)

    def finished(self, on_workers: Callable[[int, int], None]) -> Iterator[Finished]:
        """Make the products of the jobs."""
        while self._jobs:
            job = self._jobs.pop()
            call = job.call
            module, _, function = call.task.partition(":")
            result = getattr(importlib.import_module(module), function)(call.request)
            own = {"fingerprint": call.fingerprint, "provenance": dict(call.parts)}
            for target, content in zip(
                call.targets, result if isinstance(result, tuple) else (result,), strict=True
            ):
                if isinstance(content, Product):
                    self._write(target, content.with_attributes(**own))
                else:
                    target.write_bytes(to_bytes(content.with_metadata(**own)))
            outcome = Outcome(call.request.object_id, None, 1.0, 1.0, 100_000_000, call.fingerprint)
            yield Finished(job, outcome)

    def _write(self, path: Path, product: Product) -> None:
        kind = path.parent.name
        if kind not in self._entries:
            write_product(path, product)
            with zipfile.ZipFile(path) as archive:
                self._entries[kind] = {name: archive.read(name) for name in archive.namelist()}
            return
        entries = self._entries[kind]
        group: dict[str, Any] = {**json.loads(entries[GROUP]), "attributes": dict(product.attributes)}
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
            for name, data in {**entries, GROUP: json.dumps(group, indent=2).encode()}.items():
                archive.writestr(zipfile.ZipInfo(name, ZIP_DATE), data)


class Copying:
    """Makes the pages of the report at once, in this process."""

    def __init__(self) -> None:
        self._jobs: list[Job] = []

    def submit(self, job: Job) -> None:
        """Accept a job."""
        self._jobs.append(job)

    def finished(self, on_workers: Callable[[int, int], None]) -> Iterator[Finished]:
        """Draw the first page, and write the files of the others from its own."""
        first = self._jobs[0].call
        first_page = draw_page(first.request)
        stem, names = page_stem(first), first_page.metadata["names"]
        for job in self._jobs:
            call = job.call
            files = {page_stem(call) + name.removeprefix(stem): first_page.tensors[name] for name in names}
            page = first_page.tensors[names[-1]].tobytes()
            page = page.replace(first.fingerprint.encode(), call.fingerprint.encode())
            files[f"{page_stem(call)}.html"] = np.frombuffer(page, np.uint8)
            call.targets[0].parent.mkdir(parents=True, exist_ok=True)
            call.targets[0].write_bytes(to_bytes(TensorFile(files, {"names": list(files)})))
            yield Finished(job, Outcome(call.request.object_id, None, 0.0, 0.0, 0, call.fingerprint))


def page_stem(call: Call) -> str:
    """Return the name of the files of a page, without their suffixes."""
    return page_name(call.request.object_id).removesuffix(".html")


@contextmanager
def fabricating(jobs: int) -> Iterator[Fabricating]:
    """Who makes the products."""
    yield Fabricating()


@contextmanager
def copying(pages: int) -> Iterator[Copying]:
    """Who makes the pages."""
    yield Copying()


def main() -> int:
    """Make all products and the report; return 1 where one failed."""
    root = Path.cwd()
    parameters = read_parameters(root / "params.yaml")
    records = read_table(root, parameters.objects)
    write_records(root, records)
    summaries = converge(list(STAGES.values()), root, parameters, records.rows, fabricating)
    write_report(root / FIDELITY.folder, costs_path(root), root / REPORTS, runner_for=copying)
    return 1 if any(summary.failures for summary in summaries) else 0


if __name__ == "__main__":
    sys.exit(main())
