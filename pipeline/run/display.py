"""What those who wait see: a line beside a spinner on a terminal, now and then in a log."""

import sys
import threading
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self, TextIO

if TYPE_CHECKING:
    from rich.console import Console

LOG_INTERVAL_S = 30.0


class Display:
    """Shows on standard error how a computation stands, from a thread of its own, until it is stopped.

    Parameters
    ----------
    line
        Returns the state in a line.
    stream
        Where to (default: standard error).
    delay_s
        Seconds before the first line of a log: what ends earlier leaves none.
    """

    def __init__(
        self,
        line: Callable[[], str],
        stream: TextIO | None = None,
        delay_s: float = 0.0,
    ) -> None:
        self._line, self._delay_s = line, delay_s
        self._stream = stream or sys.stderr
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)

    def start(self) -> None:
        """Begin to show, if that has not begun."""
        if not self._thread.ident:
            self._thread.start()

    def stop(self) -> None:
        """End it; the line on a terminal is erased, those of a log stay."""
        self._stopped.set()
        if self._thread.ident:
            self._thread.join()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _show(self) -> None:
        if self._stream.isatty():
            from rich.console import Console

            console = Console(file=self._stream, force_terminal=True, highlight=False)
            if console.is_interactive:
                self._draw(console)
                return
        wait_s = self._delay_s
        while not self._stopped.wait(wait_s):
            print(self._line(), file=self._stream, flush=True)
            wait_s = LOG_INTERVAL_S

    def _draw(self, console: "Console") -> None:
        from rich.live import Live
        from rich.spinner import Spinner
        from rich.text import Text

        spinner = Spinner("dots")

        def beside_spinner() -> Spinner:
            spinner.update(text=Text(self._line()))
            return spinner

        screen = sys.stdout.isatty()  # output to a file must not appear on the terminal
        with Live(
            get_renderable=beside_spinner,
            console=console,
            transient=True,
            redirect_stdout=screen,
            refresh_per_second=4,
        ):
            self._stopped.wait()
