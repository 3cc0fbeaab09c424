"""Make the products of a repository of `bench.factory.overhead_repository`, run as a script in its folder.

Every kind is made once by its task body and written as any product is; the others get the arrays of the
first and attributes of their own, for packing arrays of thousands of products is not what is measured.
"""

import importlib
import json
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from objectfolder.products.store import ZIP_DATE, Product, write_product
from objectfolder.products.tensor_file import to_bytes
from pipeline.dataset.job import Finished, Job
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.records import read_table, write_records
from pipeline.dataset.stages import STAGES
from pipeline.dataset.task import Outcome
from pipeline.run.converge import converge

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
            made = getattr(importlib.import_module(module), function)(call.request)
            own = {"fingerprint": call.fingerprint, "provenance": dict(call.parts)}
            for target, content in zip(
                call.targets, made if isinstance(made, tuple) else (made,), strict=True
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


@contextmanager
def fabricating(jobs: int) -> Iterator[Fabricating]:
    """Who makes the products."""
    yield Fabricating()


def main() -> int:
    """Make all products; return 1 where one failed."""
    root = Path.cwd()
    parameters = read_parameters(root / "params.yaml")
    records = read_table(root, parameters.objects)
    write_records(root, records)
    summaries = converge(list(STAGES.values()), root, parameters, records.rows, fabricating)
    return 1 if any(summary.failures for summary in summaries) else 0


if __name__ == "__main__":
    sys.exit(main())
