"""What a Dask task runs in a worker: a call, in a child process of the worker's thread."""

import contextlib
import os
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.dataset import products
from pipeline.dataset.task import Call, Outcome
from pipeline.sandbox.isolation import Child, ChildSettings, ProcessKilled


@dataclass(frozen=True)
class Answer:
    """A worker's answer to a call.

    Parameters
    ----------
    worker, host
        Where it ran.
    outcome
        How it ended; None where its process was killed, or its inputs are not in the store.
    killed
        How its process was killed, if it was.
    shipped
        Whether its products are in the store, and not in the data folder.
    """

    worker: str
    host: str
    outcome: Outcome | None = None
    killed: str = ""
    shipped: bool = False


def run_task(
    call: Call,
    shipment: Call | None,
    root: Path,
    marker: Path,
    settings: ChildSettings,
    expected_bytes: int,
) -> Answer:
    """Run a call in the child process of this worker thread.

    Where the worker cannot read the marker, a file in the data folder `root`, the shipment is run in its
    place, which is None if its inputs are not in the store yet.
    """
    from distributed import get_worker

    worker = get_worker()
    shares = os.access(marker, os.R_OK)
    answer = Answer(worker.address, _host(worker.ip), shipped=not shares)
    # Made by an earlier try whose answer was lost?
    if shares and products.are_whole(call.targets, call.fingerprint):
        return replace(answer, outcome=Outcome(call.request.object_id, fingerprint=call.fingerprint))
    if not shares and shipment is None:
        return answer
    child = _child(root if shares else Path.cwd(), settings)
    try:
        with _ended_if_given_up(worker.get_current_task(), child):
            outcome = child.run(call if shares or shipment is None else shipment, expected_bytes)
    except ProcessKilled as error:
        return replace(answer, killed=str(error))
    return replace(answer, outcome=outcome)


def give_up(key: str) -> None:
    """End the child process of a task that was cancelled."""
    with _lock:
        child = _children.get(key)
        if child is not None:
            child.interrupt()


_lock = threading.Lock()
_children: dict[str, Child] = {}  # by key of the task
_of_thread = threading.local()


@contextlib.contextmanager
def _ended_if_given_up(key: str, child: Child) -> Iterator[None]:
    with _lock:
        _children[key] = child
    try:
        yield
    finally:
        with _lock:
            del _children[key]


def _child(root: Path, settings: ChildSettings) -> Child:
    """Return the child of this thread; a worker may see several runs, each with its own settings."""
    entry = getattr(_of_thread, "child", None)
    if entry is None or entry[0] != (root, settings):
        if entry is not None:
            entry[1].__exit__()
        entry = _of_thread.child = ((root, settings), Child(root, settings))
    child: Child = entry[1]
    return child


def _host(ip: str) -> str:
    """Return one name for all workers of a machine; hosts with one name differ by their addresses."""
    name = socket.gethostname()
    return name if ip.startswith("127.") or ip == "::1" else f"{name} ({ip})"
