"""A live page in a thread of the tests."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from pipeline.publish.viewer.live import Page, Server, page_of_objects
from pipeline.publish.viewer.live_queries import LiveObjects


def served(*paths: Path) -> AbstractContextManager[Server]:
    """Serve Object Files while the context lasts."""
    return served_page(page_of_objects(LiveObjects(paths)))


@contextmanager
def served_page(page: Page) -> Iterator[Server]:
    """Serve a page while the context lasts."""
    server = Server(page)
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
