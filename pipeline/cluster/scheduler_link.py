"""The line to a Dask scheduler: what happens there, in the order in which it was told."""

import queue
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.cluster.worker_task import TOPIC

WORKERS = "all"  # Dask's topic for workers that come and go
CLOSE_S = 10.0
JOINED, LEFT, TOLD, ENDED = "joined", "left", "told", "ended"


@dataclass(frozen=True)
class Event:
    """Something that happened.

    Parameters
    ----------
    kind
        What.
    subject
        To what: a worker, an answer of one, the key of a task.
    connection
        In which connection; None for what does not depend on one.
    """

    kind: str
    subject: Any
    connection: int | None = None


class SchedulerLink:
    """A client of the scheduler that may be opened again after the scheduler went away.

    Parameters
    ----------
    connect
        Returns a client, given the seconds it may take; raises OSError where there is no scheduler.
    run
        Name of the run: answers to others are not heard.
    """

    def __init__(self, connect: Callable[[float], Any], run: str) -> None:
        self._connect = connect
        self._run = run
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._connection = 0
        self._client: Any = None
        self._stream: Any = None

    def open(self, seconds: float) -> None:
        """Connect, and listen to what happens from now on.

        Raises
        ------
        OSError
            No scheduler answered in time.
        """
        self._connection += 1
        connection = self._connection
        self._client = self._connect(seconds)
        self._stream = self._client.scheduler_comm

        def on_worker(event: tuple[float, Mapping[str, Any]]) -> None:
            message = event[1]
            if message.get("action") == "add-worker":
                self.tell(Event(JOINED, message["worker"], connection))
            elif message.get("action") == "remove-worker":
                self.tell(Event(LEFT, message["worker"], connection))

        def on_answer(event: tuple[float, Mapping[str, Any]]) -> None:
            if event[1].get("run") == self._run:
                self.tell(Event(TOLD, event[1], connection))

        self._client.subscribe_topic(WORKERS, on_worker)
        self._client.subscribe_topic(TOPIC, on_answer)

    def close(self) -> None:
        """Leave the scheduler."""
        if self._client is None:
            return
        if self._client.status == "running":
            for topic in (WORKERS, TOPIC):  # or the scheduler would tell this client that it left
                self._client.unsubscribe_topic(topic)
        self._client.close(timeout=CLOSE_S)

    @property
    def client(self) -> Any:
        """The client of this connection."""
        return self._client

    @property
    def address(self) -> str:
        """The scheduler's."""
        return str(self._client.scheduler.address)

    def is_up(self) -> bool:
        """Return whether this is still the connection that was opened."""
        return self._client.status == "running" and self._client.scheduler_comm is self._stream

    def workers(self) -> set[str]:
        """Return the addresses of the workers that the scheduler knows now."""
        return set(self._client.scheduler_info(n_workers=-1)["workers"])

    def submit(self, worker: str, function: Callable[..., None], key: str, *arguments: Any) -> Any:
        """Run ``function(run, key, *arguments)`` on a worker and nowhere else; return its future."""
        future = self._client.submit(
            function,
            self._run,
            key,
            *arguments,
            key=key,
            workers=[worker],
            allow_other_workers=False,
            pure=False,
        )
        connection = self._connection
        future.add_done_callback(lambda _: self.tell(Event(ENDED, key, connection)))
        return future

    def tell(self, event: Event) -> None:
        """Note an event, from any thread."""
        self._events.put(event)

    def events(self, seconds: float) -> list[Event]:
        """Return what happened, after waiting up to `seconds` for a first event."""
        found = []
        try:
            found.append(self._events.get(timeout=seconds))
            while True:
                found.append(self._events.get_nowait())
        except queue.Empty:
            return [event for event in found if event.connection in (None, self._connection)]


def error_of(future: Any) -> BaseException:
    """Return why a future ended of which nothing was told."""
    error = future.exception() if future.status == "error" else None
    return error if isinstance(error, BaseException) else RuntimeError(f"its task was {future.status}")
