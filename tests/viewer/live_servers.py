"""A live page in a thread of the tests.

Its finest images are small: those of 512 pixels a side take seconds each.
"""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from pipeline.publish.viewer.live import Page, Server, page_of_objects
from pipeline.publish.viewer.live_queries import LiveObjects

FINEST = 128  # pixels a side


class SmallPage(Page):
    """A page whose finest images have `FINEST` pixels a side."""

    def files(self) -> dict[str, tuple[str, bytes]]:
        """Return name and content of each file by its path."""
        old, new = b"resolution: 512,", b"resolution: %d," % FINEST
        files = super().files()
        assert any(old in content for _, content in files.values())
        return {path: (name, content.replace(old, new)) for path, (name, content) in files.items()}


def served(*paths: Path, token: str = "") -> AbstractContextManager[Server]:
    """Serve Object Files while the context lasts."""
    return served_page(page_of_objects(LiveObjects(paths)), token)


@contextmanager
def served_page(page: Page, token: str = "") -> Iterator[Server]:
    """Serve a page while the context lasts."""
    server = Server(SmallPage(**vars(page)), token=token)
    loop, stopped = asyncio.new_event_loop(), asyncio.Event()

    def run() -> None:
        asyncio.set_event_loop(loop)
        loop.run_until_complete(server.serve(stopped.wait()))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield server
    finally:
        loop.call_soon_threadsafe(stopped.set)
        thread.join()
        loop.close()
