"""What runs inside a worker: its introduction to the driver, and jobs in a child process of it.

Answers go to the driver as events through the scheduler, ahead of the news that the task ended: no
result stays on a worker that may die before it is fetched.
"""

import contextlib
import dataclasses
import importlib.util
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.cluster.environment_check import Environment, differences
from pipeline.dataset.crew import BLENDER, GPU
from pipeline.dataset.task import Call, Failure, Outcome
from pipeline.sandbox import host_memory
from pipeline.sandbox.isolation import Child, ChildSettings, Interrupted, ProcessKilled

if TYPE_CHECKING:
    from pipeline.store.shipping import Shipment

TOPIC = "objectfolder"
HOST = "OBJECTFOLDER_WORKER_HOST"
MEMORY = "OBJECTFOLDER_WORKER_MEMORY_GB"
POOLS = (BLENDER, GPU)
NOTHING = "nothing"  # resource of a worker that was started for no pool
USABLE = 0.9  # of a host's memory, where nobody said how much
ABANDONED = ("executing", "released")  # what Dask calls a running task that nobody waits for any more
CHECK_LIMIT_S = 600.0


@dataclass(frozen=True)
class Question:
    """What the driver wants to know of a worker before it gives it work.

    Parameters
    ----------
    root
        The data folder.
    token_name, token
        A file in the data folder and its content: who reads it there shares the folder.
    wanted
        The environment to have; None where it is the driver's own by construction.
    memory_gb
        Memory of its host that tasks may take; None for what the worker says.
    """

    root: Path
    token_name: str
    token: str
    wanted: Environment | None = None
    memory_gb: float | None = None


@dataclass(frozen=True)
class Introduction:
    """A worker as the driver sees it.

    Parameters
    ----------
    host
        Workers of one host share its memory.
    memory_bytes
        What tasks may take on this host.
    offers
        Pools that it belongs to.
    threads
        Tasks that it can run at once.
    shares_folder
        Whether it sees the driver's data folder.
    differing
        Why it would compute other numbers; empty where it may work.
    """

    host: str
    memory_bytes: int
    offers: tuple[str, ...]
    threads: int
    shares_folder: bool
    differing: tuple[str, ...] = ()


def introduce(run: str, key: str, question: Question) -> None:
    """Tell the driver who this worker is."""
    worker = _worker()
    worker.loop.add_callback(worker.plugins.__setitem__, GivenUp.__name__, _given_up)
    shares = _shares(question)
    answer = Introduction(
        host=os.environ.get(HOST) or _host(worker.ip),
        memory_bytes=usable_bytes(question.memory_gb),
        offers=_stated(worker.state.total_resources),
        threads=worker.state.nthreads,
        shares_folder=shares,
        differing=_differing(question, shares),
    )
    worker.log_event(TOPIC, {"run": run, "key": key, "introduction": dataclasses.asdict(answer)})


def run_on_worker(
    run: str,
    key: str,
    call: "Call | Shipment",
    settings: ChildSettings,
    root: Path | None,
    expected_bytes: int,
) -> None:
    """Run a call in the child process of this worker thread, and tell the driver what became of it.

    The child runs in the data folder `root`, or here if the folder is not shared. When the driver gives
    the task up, or is gone, the child ends too.
    """
    worker = _worker()
    child = _child(root or Path.cwd(), settings)
    answer: dict[str, Any] = {"run": run, "key": key}
    try:
        with _given_up.ends(key, child):
            answer["outcome"] = as_message(child.run(call, expected_bytes))
    except ProcessKilled as error:
        answer["lost"] = str(error)
    except Interrupted:
        return
    worker.log_event(TOPIC, answer)


class GivenUp:
    """A plugin of the worker that ends the child of a task that nobody waits for any more."""

    def __init__(self) -> None:
        self._children: dict[str, Child] = {}
        self._lock = threading.Lock()

    @contextlib.contextmanager
    def ends(self, key: str, child: Child) -> Iterator[None]:
        """Let `child` end with the task `key` as long as this lasts."""
        with self._lock:
            self._children[key] = child
        try:
            yield
        finally:
            with self._lock:
                del self._children[key]

    def transition(self, key: str, start: str, finish: str, **_: Any) -> None:
        """Take the news of a task from the worker."""
        if (start, finish) == ABANDONED:
            with self._lock:
                child = self._children.get(key)
                if child is not None:
                    child.interrupt()


_given_up = GivenUp()


def as_message(outcome: Outcome) -> dict[str, Any]:
    """Return an outcome as plain data."""
    message = dataclasses.asdict(dataclasses.replace(outcome, query_seconds={}))
    message["query_seconds"] = {name: float(value) for name, value in outcome.query_seconds.items()}
    return message


def from_message(message: Mapping[str, Any]) -> Outcome:
    """Return what `as_message` was given."""
    failure = message["failure"]
    return Outcome(**{**message, "failure": Failure(**failure) if failure else None})


_own = threading.local()


def _child(root: Path, settings: ChildSettings) -> Child:
    """Return the child of this thread; a worker may see several runs, each with its own settings."""
    made = getattr(_own, "made", None)
    if made is None or made[0] != (root, settings):
        if made is not None:
            made[1].__exit__(None, None, None)
        made = _own.made = ((root, settings), Child(root, settings))
    child: Child = made[1]
    return child


def _worker() -> Any:
    from distributed import get_worker

    return get_worker()


def _host(ip: str) -> str:
    """Return one name for all workers of a machine; hosts with one name differ by their addresses."""
    name = socket.gethostname()
    return name if ip.startswith("127.") or ip == "::1" else f"{name} ({ip})"


def usable_bytes(stated_gb: float | None = None) -> int:
    """Return the memory that tasks may take on this host: what its worker or the place says, else most."""
    own_gb = os.environ.get(MEMORY)
    if own_gb:
        return int(float(own_gb) * 1e9)
    return int(stated_gb * 1e9 if stated_gb is not None else USABLE * host_memory.total_bytes())


def offers_here() -> tuple[str, ...]:
    """Return the pools that this process can serve, by what is installed; nothing is imported."""
    able = {BLENDER: importlib.util.find_spec("bpy") is not None, GPU: _has_gpu()}
    return tuple(pool for pool, there in able.items() if there)


def _stated(resources: Mapping[str, float]) -> tuple[str, ...]:
    """Return the pools that a worker was started for, else those that it can serve."""
    if any(name in resources for name in (*POOLS, NOTHING)):
        return tuple(pool for pool in POOLS if resources.get(pool))
    return offers_here()


def _has_gpu() -> bool:
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    if visible is not None and visible.strip() in ("", "-1", "NoDevFiles"):
        return False
    return any(Path("/dev").glob("nvidia[0-9]*")) or Path("/dev/dxg").exists()


def _shares(question: Question) -> bool:
    try:
        return (question.root / question.token_name).read_text() == question.token
    except OSError:
        return False


def _differing(question: Question, shares: bool) -> tuple[str, ...]:
    """Return how this worker differs, seen from where its children run."""
    if question.wanted is None:
        return ()
    answer = subprocess.run(
        [sys.executable, "-m", "pipeline.cluster.environment_check"],
        input=question.wanted.as_json(),
        capture_output=True,
        text=True,
        cwd=question.root if shares else None,
        timeout=CHECK_LIMIT_S,
        check=False,
    )
    if answer.returncode:
        lines = answer.stderr.strip().splitlines() or [f"exit {answer.returncode}"]
        return (f"its environment cannot be read ({lines[-1]})",)
    return tuple(differences(question.wanted, Environment.from_json(answer.stdout)))
