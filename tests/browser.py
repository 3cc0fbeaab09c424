"""Headless Chromium for the tests of pages: a test module says ``pytest_plugins = ["tests.browser"]``.

`open_page` opens a page that records what it asks for and what goes wrong in it; `browser` is Playwright's
own. Playwright drives the Chromium of the system: nothing is downloaded.
"""

import contextlib
import os
import shutil
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.patience import LOOK_S, OwnClock

CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# A machine without a graphics card draws WebGL by SwiftShader; sound plays without a click before it.
ARGUMENTS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--autoplay-policy=no-user-gesture-required",
)
# Conditions are waited for this long at most, by an `OwnClock`, since a page asked for or said anything.
PATIENCE_S = 120.0
PROGRESS = ("console", "framenavigated", "pageerror", "request", "response")


@dataclass
class Watched:
    """A page and what happened in it: every address asked for, every error of scripts and console."""

    page: Any
    requests: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    @property
    def left_the_machine(self) -> list[str]:
        """Requests that are not for a file, for data in the page itself or for this host."""
        own = ("file:", "data:", "blob:", "about:", "http://127.0.0.1", "http://localhost")
        return [address for address in self.requests if not address.startswith(own)]


def chromium() -> str:
    """Return the path of the system's Chromium.

    Where there is none, the test is skipped; with ``OBJECTFOLDER_BROWSER=required`` in the environment it
    fails, so that a check of everything cannot pass with its pages untested.
    """
    executable = next(filter(None, map(shutil.which, CHROMIUM)), None)
    if executable is None:
        finding = f"no {', '.join(CHROMIUM)} in PATH"
        if os.environ.get("OBJECTFOLDER_BROWSER") == "required":
            pytest.fail(finding)
        pytest.skip(finding)
    return executable


class Watchdog:
    """Ends the browser where nothing has happened in its pages for too long.

    Playwright's own limits are wall time, which other work on the machine uses up. They are off.
    """

    def __init__(self, patience_s: float = PATIENCE_S) -> None:
        self._patience_s = patience_s
        self._progress, self._closed = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self.ended = False

    def __enter__(self) -> "Watchdog":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        self._thread.join()

    def progress(self, *_: object) -> None:
        """Something happened: wait as long again."""
        self._progress.set()

    def _watch(self) -> None:
        clock = OwnClock()
        while not self._closed.wait(LOOK_S):
            if self._progress.is_set():
                self._progress.clear()
                clock.set_back()
            elif clock.read() > self._patience_s:
                self.ended = True
                # Playwright's driver stays and tells the caller that its browser is gone.
                for process in psutil.Process().children(recursive=True):
                    with contextlib.suppress(psutil.Error):
                        if process.name().startswith(("chrom", "google-chrom")):
                            process.kill()
                return


# Of a module, not a session: while Playwright lives, no other test can run an event loop of its own.
@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A headless Chromium (`playwright.sync_api.Browser`); skips where there is none, see `chromium`."""
    executable = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        launched = driver.chromium.launch(executable_path=executable, args=list(ARGUMENTS), timeout=0)
        yield launched
        launched.close()


class Tabs:
    """Pages that tests take in turn: a process of its own for each costs more than most tests."""

    def __init__(self, browser: Any) -> None:
        self._browser = browser
        self._idle: defaultdict[tuple[tuple[str, Any], ...], list[Any]] = defaultdict(list)

    @contextlib.contextmanager
    def page(self, init_script: str = "", **settings: Any) -> Iterator[Any]:
        """A blank page in a context of its own, which holds nothing of an earlier test."""
        size = settings.pop("viewport", {"width": 1280, "height": 720})
        scheme = settings.pop("color_scheme", "light")
        idle = self._idle[("init_script", init_script), *sorted(settings.items())]
        page = idle.pop() if idle else self._new_page(init_script, settings)
        page.set_viewport_size(size)
        page.emulate_media(color_scheme=scheme)
        yield page
        if not page.is_closed():
            page.evaluate("['file:', 'http:'].includes(location.protocol) && localStorage.clear()")
            page.context.clear_cookies()
            page.context.clear_permissions()
            page.goto("about:blank")
            idle.append(page)

    def _new_page(self, init_script: str, settings: Mapping[str, Any]) -> Any:
        context = self._browser.new_context(**settings)
        context.set_default_timeout(0)
        context.add_init_script(init_script)
        return context.new_page()


@pytest.fixture(scope="module")
def tabs(browser: Any) -> Tabs:
    """The pages of a module's tests."""
    return Tabs(browser)


def listen(page: Any, stack: contextlib.ExitStack, *handlers: tuple[str, Callable[..., None]]) -> None:
    """Call functions on events of a page until the stack is unwound."""
    for event, handler in handlers:
        page.on(event, handler)
        stack.callback(page.remove_listener, event, handler)


@pytest.fixture
def open_page(tabs: Tabs) -> Iterator[Callable[..., Watched]]:
    """A function that opens a file or an address in a page of its own and returns it `Watched`.

    Its keywords are those of `Browser.new_context`, ``color_scheme="dark"``, ``viewport={...}``, and
    ``init_script``, which runs in the page ahead of its own scripts.
    """
    watchdog = Watchdog()
    with contextlib.ExitStack() as stack:

        def open_in_a_tab(place: Path | str, **settings: Any) -> Watched:
            page = stack.enter_context(tabs.page(**settings))
            watched = Watched(page)
            listen(page, stack, *((event, watchdog.progress) for event in PROGRESS))
            listen(
                page,
                stack,
                ("request", lambda request: watched.requests.append(request.url)),
                ("pageerror", lambda error: watched.errors.append(str(error))),
                (
                    "console",
                    lambda message: watched.errors.append(message.text) if message.type == "error" else None,
                ),
            )
            page.goto(place.resolve().as_uri() if isinstance(place, Path) else place)
            return watched

        with watchdog:
            yield open_in_a_tab
        if watchdog.ended:
            stack.pop_all()
            pytest.fail(f"nothing happened in the page for {PATIENCE_S:g} s of the processes' own")
