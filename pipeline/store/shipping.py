"""Jobs for workers that do not share the data folder: inputs and products travel through a store.

The driver publishes a job's inputs and collects its products; the `Shipment` between the two runs in the
worker's child process. Everything in the store is named by its content (products by
fingerprint, source files by SHA-256). So a file that the store has is not sent again, and a second writer
changes nothing.
"""

import functools
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from objectfolder.errors import FormatError, InputError, ObjectFolderError, SimulationError
from objectfolder.making.mesh.readers.load import source_files
from objectfolder.products.provenance import file_digest
from pipeline.dataset import products
from pipeline.dataset.job import Job
from pipeline.dataset.task import Call, Outcome, failure_of
from pipeline.store.input_cache import InputCache, open_cache
from pipeline.store.storage import Store, disk_error, product_name, source_name

MESH, TEXTURE = "mesh", "texture"


@dataclass(frozen=True)
class StoredInput:
    """An input of a job.

    Parameters
    ----------
    place
        Path below the job's folder, with slashes; source files lie to one another as at home.
    content
        Fingerprint of a product, SHA-256 of a source file.
    is_product
        Which of the two.
    """

    place: str
    content: str
    is_product: bool

    @property
    def name(self) -> str:
        """Its name in the store."""
        if not self.is_product:
            return source_name(self.content)
        return product_name(self.content, products.kind_name(Path(self.place)))

    def check(self, path: Path) -> None:
        """Raise FormatError unless the file at `path` is this one, whole."""
        if self.is_product:
            products.check(path, self.content)
        elif file_digest(path) != self.content:
            raise FormatError(str(path), "another content than its name says", "Run again.")


@dataclass(frozen=True)
class Shipment(Call):
    """A call with all its inputs in a store, to be run anywhere; its paths mean nothing where it runs.

    Parameters
    ----------
    inputs
        Where the store has its inputs, by name.
    url
        The store.
    """

    inputs: Mapping[str, StoredInput] = field(default_factory=dict)
    url: str = ""

    def run(self, execute: Callable[[Call], Outcome]) -> Outcome:
        """Fetch inputs, run the call in this process, and put its products into the store, last of all.

        Products that are there already (or here, from a job that could not send them) are not made
        again; the outcome then has no cost.
        """
        try:
            store, cache = _store(self.url), open_cache()
            with tempfile.TemporaryDirectory(prefix="shipment-") as folder:
                return self._run(execute, store, cache, Path(folder))
        except (ObjectFolderError, OSError) as error:
            trouble = error
            if isinstance(error, OSError):  # of this host's disk
                trouble = disk_error(error, error.filename or tempfile.gettempdir())
            failure = failure_of(self.request.object_id, trouble)
            return Outcome(self.request.object_id, failure, fingerprint=self.fingerprint)

    def _run(
        self, execute: Callable[[Call], Outcome], store: Store, cache: InputCache, folder: Path
    ) -> Outcome:
        targets = tuple(folder / "made" / target.parent.name / target.name for target in self.targets)
        names = _product_names(self)
        check = functools.partial(products.check, fingerprint=self.fingerprint)
        outcome = Outcome(self.request.object_id, fingerprint=self.fingerprint)
        if all(store.size(name) for name in names):
            return outcome
        if all(cache.find(name, target, check) for name, target in zip(names, targets, strict=True)):
            _send(store, names, targets)
            return outcome
        inputs = self._fetch(store, cache, folder)
        request = replace(self.request, inputs=inputs)
        outcome = execute(replace(self, request=request, targets=targets, state=None))
        if outcome.failure is None:
            for name, target in zip(names, targets, strict=True):
                cache.add(name, target)
            _send(store, names, targets)
        return outcome

    def _fetch(self, store: Store, cache: InputCache, folder: Path) -> dict[str, Path]:
        inputs = {name: folder / entry.place for name, entry in self.inputs.items()}
        for name, entry in self.inputs.items():
            try:
                trouble = cache.fetch(store, entry.name, inputs[name], entry.check)
            except FormatError as error:
                raise SimulationError(
                    store.url, f"its copy of the input {name} was damaged", "Run again: it is sent once more."
                ) from error
            if not trouble:
                raise SimulationError(
                    store.url, f"the input {name} is gone", "Run again: it is sent once more."
                )
        if MESH in inputs:
            names = {os.path.normpath(path) for path in source_files(inputs[MESH], inputs.get(TEXTURE))}
            if names != {str(path) for name, path in inputs.items() if not self.inputs[name].is_product}:
                raise InputError(
                    self.request.object_id,
                    "its mesh refers to files by a path that workers elsewhere do not have",
                    "Refer to them by paths relative to the mesh.",
                )
        return inputs


def publish(job: Job, store: Store) -> Shipment:
    """Put a job's inputs into the store, as far as they are not there.

    Raises
    ------
    InputError, SimulationError
        A file that is gone or changed, or a store that fails.
    """
    inputs = _stored_inputs(job)
    for name, entry in inputs.items():
        path = job.call.request.inputs[name]
        try:
            if store.size(entry.name) != path.stat().st_size:
                entry.check(path)
                store.put(path, entry.name)
        except FileNotFoundError as error:
            raise InputError(path.name, "an input was removed during the run", "Run again.") from error
        except FormatError as error:
            raise InputError(path.name, "changed since the run began", "Run again.") from error
    call = replace(job.call, request=replace(job.call.request, inputs={}), state=None)
    return Shipment(**vars(call), inputs=inputs, url=store.url)


def collect(job: Job, store: Store) -> None:
    """Put a finished job's products into place, each verified.

    Raises
    ------
    FormatError
        A product was missing or damaged; what was there is removed, and the job has to run again.
    InputError, SimulationError
        The store or the disk fails.
    """
    call = job.call
    names = _product_names(call)
    if store.get_all(names, call.targets) and products.are_whole(call.targets, call.fingerprint):
        return
    for name, target in zip(names, call.targets, strict=True):
        store.remove(name)
        target.unlink(missing_ok=True)
    finding = f"the product of {call.stage} of {job.object_id} is missing or damaged"
    raise FormatError(store.url, finding, "Run again.")


def _stored_inputs(job: Job) -> dict[str, StoredInput]:
    """Return what a job's inputs are and where they belong."""
    inputs = job.call.request.inputs
    suffixes = (products.ZARR, products.TENSORS)
    outputs = {name for name, path in inputs.items() if path.name.endswith(suffixes)}
    sources = {
        name: os.path.normpath(path.absolute()) for name, path in inputs.items() if name not in outputs
    }
    common = os.path.commonpath([os.path.dirname(path) for path in sources.values()]) if sources else ""
    places = {name: f"sources/{Path(path).relative_to(common).as_posix()}" for name, path in sources.items()}
    places.update({name: f"products/{name}/{inputs[name].name}" for name in outputs})
    return {name: StoredInput(places[name], job.inputs[name], name in outputs) for name in inputs}


def _product_names(call: Call) -> list[str]:
    return [product_name(call.fingerprint, products.kind_name(target)) for target in call.targets]


def _send(store: Store, names: list[str], targets: tuple[Path, ...]) -> None:
    for name, target in zip(names, targets, strict=True):
        store.put(target, name)


_store = functools.cache(Store)
