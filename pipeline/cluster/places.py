"""Descriptions of where to run: a YAML of ``cluster/``, a path of one, or a scheduler's address.

Nothing in them changes a result, so none of it is a parameter of the data set.
"""

import dataclasses
import difflib
import os
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from objectfolder.errors import InputError
from pipeline.sandbox.isolation import ChildSettings

PLACE = "OBJECTFOLDER_CLUSTER"
ADDRESS = "DASK_SCHEDULER_ADDRESS"
SCHEMES = ("tcp://", "tls://", "ws://", "wss://", "ucx://")
FOLDER = "cluster"
DEFAULT = "local"
KINDS = ("local", "ssh", "slurm", "kubernetes", "cuda", "address")
LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Ssh:
    """Machines reached by SSH.

    Parameters
    ----------
    hosts
        Where workers run.
    python
        Python there; None for the path of this one.
    folder
        Where the code and the data are there; None for the path of this folder.
    connect
        Options of ``asyncssh.connect`` (``username``, ``port``, ``client_keys``, ``known_hosts``).
    environment
        Environment variables for the workers.
    """

    hosts: list[str] = field(default_factory=list)
    python: str | None = None
    folder: str | None = None
    connect: dict[str, Any] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Slurm:
    """Jobs of a Slurm cluster; each holds some workers.

    Parameters
    ----------
    jobs
        Slurm jobs to ask for.
    cores, memory_gb
        Of a job. A job has a worker for each core, unless the place says how many.
    walltime
        Limit of a job, ``hours:minutes:seconds``.
    partition, account
        Where, and for whom.
    interface
        Network interface through which the nodes see each other (``ib0``); None for the default one.
    directives
        Further options of ``sbatch`` (``--gres=gpu:1``).
    prologue
        Shell lines before the workers start (``module load``, ``source .venv/bin/activate``).
    python
        Python on the nodes; None for the path of this one.
    logs
        Folder for the output of the jobs.
    """

    jobs: int = 1
    cores: int = 1
    memory_gb: float = 4.0
    walltime: str = "24:00:00"
    partition: str | None = None
    account: str | None = None
    interface: str | None = None
    directives: list[str] = field(default_factory=list)
    prologue: list[str] = field(default_factory=list)
    python: str | None = None
    logs: str | None = None


@dataclass(frozen=True)
class Kubernetes:
    """Pods of a Kubernetes cluster on which Dask's operator is installed.

    Parameters
    ----------
    image
        Image of scheduler and workers (``cluster/Dockerfile``).
    name, namespace
        Of the Dask cluster.
    cpus, memory_gb
        Of a worker's pod.
    gpus
        Of a worker's pod.
    environment
        Environment variables of the pods (the store and how to reach it).
    secrets
        Secrets of the namespace whose entries become environment variables (credentials of the store).
    claim
        Persistent volume claim with the data folder, mounted at ``folder``; None for a store.
    folder
        Where the claim is mounted: the path of the data folder on the driver.
    """

    image: str = ""
    name: str = "objectfolder"
    namespace: str = "default"
    cpus: float = 1.0
    memory_gb: float = 4.0
    gpus: int = 0
    environment: dict[str, str] = field(default_factory=dict)
    secrets: list[str] = field(default_factory=list)
    claim: str | None = None
    folder: str | None = None


@dataclass(frozen=True)
class Cuda:
    """GPUs of this machine, a worker for each.

    Parameters
    ----------
    devices
        Indices or UUIDs; None for all that ``CUDA_VISIBLE_DEVICES`` or the driver shows.
    """

    devices: list[str] | None = None


@dataclass(frozen=True)
class Place:
    """Where to run.

    Parameters
    ----------
    kind
        One of `KINDS`.
    workers
        Worker processes, on each host or in each job where there are several; None for one a core.
    memory_gb
        Memory of a host that tasks may take; None for 90 % of what the host has.
    address
        Of a running scheduler.
    listen
        Address at which scheduler and workers of this machine listen; None for the one by which others
        reach it.
    port
        Of the scheduler; 0 for any that is free.
    dashboard
        Address of the dashboard.
    tls
        Whether scheduler, workers and client speak to holders of the certificate alone, encrypted.
    reconnect_s
        Seconds to wait for a scheduler that went away.
    workers_within_s
        Seconds to wait for a worker while there is none; None for ever.
    pools_within_s
        Seconds, after a worker came or went, to wait for one that offers what none does.
    child
        How the child processes of the workers run.
    dask
        Settings for Dask.
    ssh, slurm, kubernetes, cuda
        What one kind needs.
    """

    kind: str = DEFAULT
    workers: int | None = None
    memory_gb: float | None = None
    address: str | None = None
    listen: str | None = LOOPBACK
    port: int = 0
    dashboard: str = f"{LOOPBACK}:0"
    tls: bool = False
    reconnect_s: float = 60.0
    workers_within_s: float | None = None
    pools_within_s: float = 60.0
    child: ChildSettings = field(default_factory=ChildSettings)
    dask: dict[str, Any] = field(default_factory=dict)
    ssh: Ssh = field(default_factory=Ssh)
    slurm: Slurm = field(default_factory=Slurm)
    kubernetes: Kubernetes = field(default_factory=Kubernetes)
    cuda: Cuda = field(default_factory=Cuda)


SECTIONS = {"ssh": Ssh, "slurm": Slurm, "kubernetes": Kubernetes, "cuda": Cuda}


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
        base = (
            _read(root / FOLDER / "address.yaml", root)
            if (root / FOLDER / "address.yaml").is_file()
            else Place()
        )
        return dataclasses.replace(
            base, kind="address", address=named, tls=base.tls or named.startswith("tls://")
        )
    path = root / FOLDER / f"{named}.yaml"
    if not path.is_file():
        path = Path(named)
    if not path.is_file() and named == DEFAULT:
        return Place()
    return _read(path, root)


def _read(path: Path, root: Path) -> Place:
    try:
        content = yaml.safe_load(path.read_text()) or {}
    except (OSError, yaml.YAMLError) as error:
        names = sorted(found.stem for found in (root / FOLDER).glob("*.yaml"))
        remedy = f"Set {PLACE} to one of {', '.join(names) or '-'}, to a YAML file, or to an address."
        raise InputError(str(path), f"cannot be read ({error})", remedy) from error
    if not isinstance(content, dict):
        raise InputError(str(path), "is no mapping of settings", "See docs/cluster.md.")
    settings = {entry.name for entry in dataclasses.fields(ChildSettings)}
    child = {key: content.pop(key) for key in list(content) if key in settings}
    if "child" in content:
        raise InputError(str(path), "unknown key 'child'", f"Set {', '.join(sorted(settings))} themselves.")
    place: Place = _made(Place, path, "", {**content, "child": child})
    _check(place, path)
    return place


def _check(place: Place, path: Path) -> None:
    if place.kind not in KINDS:
        raise InputError(str(path), f"unknown kind {place.kind!r}", f"Known are {', '.join(KINDS)}.")
    missing = {
        "ssh": (not place.ssh.hosts, "ssh.hosts", "Name the machines to run on."),
        "kubernetes": (
            not place.kubernetes.image,
            "kubernetes.image",
            "Name the image of cluster/Dockerfile.",
        ),
        "address": (not place.address, "address", "Name the scheduler (tls://host:8786)."),
    }
    if place.kind in missing and missing[place.kind][0]:
        raise InputError(str(path), f"{missing[place.kind][1]} is not set", missing[place.kind][2])


def _made(kind: Any, path: Path, section: str, content: Mapping[str, Any]) -> Any:
    """Return a dataclass of settings; every key must be known and every value of its type."""
    types_ = typing.get_type_hints(kind)
    values = {}
    for key, value in content.items():
        name = f"{section}{key}"
        if key not in types_:
            near = difflib.get_close_matches(str(key), types_, 1)
            remedy = (
                f"Did you mean {section}{near[0]}?" if near else f"Known are {', '.join(sorted(types_))}."
            )
            raise InputError(str(path), f"unknown key {name!r}", remedy)
        wanted = types_[key]
        if dataclasses.is_dataclass(wanted):
            if not isinstance(value, dict):
                raise InputError(str(path), f"{name} is {value!r}", "Give it settings of its own, indented.")
            values[key] = _made(wanted, path, f"{name}.", value)
        elif not _fits(value, wanted):
            remedy = f"Give {_words(wanted)}."
            raise InputError(str(path), f"{name} is {value!r}", remedy)
        else:
            values[key] = value
    return kind(**values)


def _fits(value: Any, wanted: Any) -> bool:
    origin, arguments = typing.get_origin(wanted), typing.get_args(wanted)
    if origin is types.UnionType:
        return any(_fits(value, one) for one in arguments)
    if origin is list:
        return isinstance(value, list) and all(_fits(one, arguments[0]) for one in value)
    if origin is dict:
        return isinstance(value, dict) and all(_fits(one, arguments[1]) for one in value.values())
    if wanted is Any:
        return True
    if wanted is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and value >= 0
    if wanted is int:
        return isinstance(value, int) and not isinstance(value, bool) and value >= 0
    return isinstance(value, wanted)


def _words(wanted: Any) -> str:
    origin, arguments = typing.get_origin(wanted), typing.get_args(wanted)
    if origin is types.UnionType:
        return " or ".join(_words(one) for one in arguments)
    if origin is list:
        return f"a list, each entry {_words(arguments[0])}"
    if origin is dict:
        return "names with values" if arguments[1] is Any else f"names, each with {_words(arguments[1])}"
    words = {
        int: "a whole number",
        float: "a number",
        str: "a text",
        bool: "true or false",
        type(None): "null",
    }
    return words[wanted]
