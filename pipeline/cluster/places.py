"""Descriptions of where to run: a YAML of ``cluster/``, a path of one, or a scheduler's address.

Nothing in them changes a result, so they are not parameters of the data set.
"""

import os
from pathlib import Path
from typing import Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveInt,
    ValidationInfo,
    field_validator,
)

from objectfolder.errors import InputError
from pipeline.cluster.pools import USABLE
from pipeline.dataset.validation import read_yaml, validated
from pipeline.sandbox.isolation import ChildSettings

PLACE = "OBJECTFOLDER_CLUSTER"
ADDRESS = "DASK_SCHEDULER_ADDRESS"
SCHEMES = ("tcp://", "tls://", "ws://", "wss://", "ucx://")
FOLDER = "cluster"
DEFAULT = "local"
LOCAL, CUDA, SSH = "distributed.LocalCluster", "dask_cuda.LocalCUDACluster", "distributed.SSHCluster"
STARTED_S = 120.0  # within which workers that need no queue have started
HERE = (LOCAL, CUDA)  # classes whose workers run this installation


class Adapt(BaseModel):
    """How many workers a cluster keeps: between the two numbers, as there is work."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    minimum: NonNegativeInt = 0
    maximum: PositiveInt

    @field_validator("maximum")
    @classmethod
    def _not_below_minimum(cls, maximum: int, info: ValidationInfo) -> int:
        if maximum < info.data.get("minimum", 0):
            raise ValueError("It must not be less than adapt.minimum")
        return maximum


class Place(BaseModel):
    """Where to run: a class that starts a Dask cluster, named as dask-ctl names it, or an address.

    Parameters
    ----------
    version
        Of the form.
    module, class_name, args, kwargs
        The class (``class`` in YAML) and its arguments.
    address
        Of a running scheduler; nothing is started then.
    adapt
        Bounds of the number of workers; None for a fixed number, `kwargs["n_workers"]`.
    tls
        Whether scheduler, workers and client encrypt and accept only one another. True: a
        certificate for this run, handed to the workers by the class. A path: the file that all of them have.
    environment
        Environment variables of the workers.
    memory_gb
        Memory of a host that tasks may take; None for 90 % of what the host has.
    reconnect_s
        Seconds to wait for a scheduler to answer.
    workers_within_s
        Seconds to wait while the scheduler has no worker; None for ever.
    pools_within_s
        Seconds, after a worker came or went, to wait for one that offers what none does.
    threads, recycle_after, time_limit_s, memory_limit_bytes
        Of the child processes of the workers (`pipeline.sandbox.isolation.ChildSettings`).
    dask
        Settings of Dask.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, validate_by_name=True, validate_by_alias=True
    )

    version: Literal[1] = 1
    module: str = "distributed"
    class_name: str = Field(default="LocalCluster", alias="class")
    args: list[Any] = []
    kwargs: dict[str, Any] = {}
    address: str | None = None
    adapt: Adapt | None = None
    tls: bool | str = True
    environment: dict[str, str] = {}
    memory_gb: NonNegativeFloat | None = None
    reconnect_s: NonNegativeFloat = 60.0
    workers_within_s: NonNegativeFloat | None = None
    pools_within_s: NonNegativeFloat = 60.0
    threads: PositiveInt = 1
    recycle_after: PositiveInt = 50
    time_limit_s: NonNegativeFloat = 7200.0
    memory_limit_bytes: PositiveInt | None = None
    dask: dict[str, Any] = {}

    @property
    def starts(self) -> str:
        """The class that is started, with its module; empty for a scheduler that runs already."""
        return "" if self.address else f"{self.module}.{self.class_name}"

    @property
    def child(self) -> ChildSettings:
        """How the child processes of the workers run."""
        return ChildSettings(self.recycle_after, self.time_limit_s, self.threads, self.memory_limit_bytes)

    @property
    def worker_limit_s(self) -> float | None:
        """Seconds to wait while the scheduler has no worker; workers that need no queue start soon."""
        if self.workers_within_s is None and self.starts in (*HERE, SSH):
            return STARTED_S
        return self.workers_within_s

    def capacity(self) -> tuple[int, int | None, int | None]:
        """Return the workers at most, and tasks at a time and bytes of each; None where it is not said."""
        from dask.utils import parse_bytes

        hosts = len(self.kwargs.get("hosts", [])[1:]) or self.kwargs.get("n_workers", 1)
        memory = self.kwargs.get("memory")
        memory_gb = self.memory_gb or (USABLE * parse_bytes(memory) / 1e9 if memory else None)
        tasks = self.kwargs.get("cores") or self.kwargs.get("threads_per_worker")
        return self.adapt.maximum if self.adapt else hosts, tasks, int(memory_gb * 1e9) if memory_gb else None


def read_place(root: Path, named: str | None = None) -> Place:
    """Read where to run.

    Parameters
    ----------
    root
        The data folder, with ``cluster/``.
    named
        A name in ``cluster/``, a path of a YAML, or an address; None for what ``OBJECTFOLDER_CLUSTER``
        says, else a scheduler named by ``DASK_SCHEDULER_ADDRESS``, else ``local``.

    Raises
    ------
    InputError
        A file that is missing, is no YAML, or has a key or a value that cannot be.
    """
    named = named or os.environ.get(PLACE) or os.environ.get(ADDRESS) or DEFAULT
    if named.startswith(SCHEMES):
        path = root / FOLDER / "address.yaml"
        content = read_yaml(path) if path.is_file() else {}
        return validated(str(path), Place, {**(content or {}), "address": named})
    path = root / FOLDER / f"{named}.yaml"
    if not path.is_file():
        path = Path(named)
    if path.is_file():
        return validated(str(path), Place, read_yaml(path) or {})
    if named == DEFAULT:
        return Place()
    names = sorted(file.stem for file in (root / FOLDER).glob("*.yaml"))
    remedy = f"Set {PLACE} to one of {', '.join(names) or '-'}, to a YAML file, or to an address."
    raise InputError(str(path), "is no place", remedy)
