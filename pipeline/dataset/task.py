"""What goes to a task and what comes back: plain data that any process can pickle."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from objectfolder.errors import ObjectFolderError


@dataclass(frozen=True)
class Request:
    """All that a task body sees; every value of it is part of the fingerprint.

    Attributes
    ----------
    object_id : the object
    inputs : input name to file: products of earlier stages by kind (``"objects"``), source files by role
    parameters : the parameters that the stage declares it reads
    record : the fields of the object's row that the stage declares it reads
    seed : seed of this task and object
    """

    object_id: str
    inputs: Mapping[str, Path]
    parameters: Mapping[str, Any]
    record: Mapping[str, Any]
    seed: int


@dataclass(frozen=True)
class Call:
    """A task body to run in a child process, and where its products go.

    Attributes
    ----------
    stage : name of the stage
    task : ``module:function``; the function takes a `Request` and returns a product for each target
        (`objectfolder.products.store.Product` or `objectfolder.products.tensor_file.TensorFile`), in a tuple
        if several
    request : its argument
    targets : Absolute paths of the products
    fingerprint, parts : what to write into each product
    state : folder where the names of products wait that a shared store does not take; None to share nothing
    """

    stage: str
    task: str
    request: Request
    targets: tuple[Path, ...]
    fingerprint: str
    parts: Mapping[str, Any]
    state: Path | None = None


@dataclass(frozen=True)
class Failure:
    """Why an object has no product: error, and what to do about it."""

    object_id: str
    error: str
    remedy: str = ""
    detail: str = ""  # traceback or last lines of output


@dataclass(frozen=True)
class Outcome:
    """What became of a call, and what it cost (CPU seconds include child processes)."""

    object_id: str
    failure: Failure | None = None
    wall_s: float = 0.0
    cpu_s: float = 0.0
    peak_bytes: int = 0
    fingerprint: str = ""
    query_seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Timed:
    """Products, and seconds that the task measured of something else than itself, by key.

    A task whose business includes timing (the fidelity of a query at several efforts) returns this in
    place of its products; the seconds go to the cost table, for products hold no timings.
    """

    products: Any
    query_seconds: Mapping[str, float]


def failure_of(object_id: str, error: BaseException, detail: str = "") -> Failure:
    """Return `error` as data; an `ObjectFolderError` keeps its finding and remedy apart."""
    if isinstance(error, ObjectFolderError):
        where = "" if error.where == object_id else f"{error.where}: "
        return Failure(object_id, f"{where}{error.finding}", error.remedy)
    if isinstance(error, SystemExit):
        return Failure(object_id, f"the task called exit({error.code!r})", "Report this as a defect.", detail)
    message = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return Failure(object_id, message, "Its traceback is in the record of the run, under runs/.", detail)
