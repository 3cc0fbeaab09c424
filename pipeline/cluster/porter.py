"""Carrying inputs to a store and products from it, in threads, while others run."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from pipeline.dataset.crew import Job
from pipeline.store.shipping import Courier, Shipment

THREADS = 4


class Porter:
    """A courier with hands.

    Parameters
    ----------
    root
        The data folder.
    published
        Called from a thread with a key, and what to send to a worker or why it cannot be sent.
    collected
        Called from a thread with a key, and None or why its products did not arrive.

    Raises
    ------
    InputError, SimulationError
        No store, or one that cannot be used or reached.
    """

    def __init__(
        self,
        root: Path,
        published: Callable[[str, Shipment | Exception], None],
        collected: Callable[[str, Exception | None], None],
    ) -> None:
        self._courier = Courier(root)
        self._threads = ThreadPoolExecutor(THREADS, thread_name_prefix="porter")
        self._published = published
        self._collected = collected

    def publish(self, key: str, job: Job) -> None:
        """Begin to put a job's inputs into the store."""
        self._threads.submit(self._publish, key, job)

    def collect(self, key: str, job: Job) -> None:
        """Begin to get a job's products from the store."""
        self._threads.submit(self._collect, key, job)

    def close(self) -> None:
        """Wait for what is on its way; what has not begun is dropped."""
        self._threads.shutdown(wait=True, cancel_futures=True)

    def _publish(self, key: str, job: Job) -> None:
        try:
            self._published(key, self._courier.publish(job))
        except Exception as error:
            self._published(key, error)

    def _collect(self, key: str, job: Job) -> None:
        try:
            self._courier.collect(job)
        except Exception as error:
            self._collected(key, error)
        else:
            self._collected(key, None)
