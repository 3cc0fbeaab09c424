"""What a person sees of running stages: one line that changes on a terminal, a line now and then in a log."""

import os
import shutil
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TextIO

from pipeline.run.forecast.time_to_go import TimeToGo

COMPUTED, KEPT, RESTORED, FAILED = "computed", "kept", "restored", "failed"
REDRAW_S = 0.2  # at most this often on a terminal
TICK_S = 1.0  # and this often where nothing happens
LOG_INTERVAL_S = (15.0, 60.0)  # between lines of a log: growing from the first to the second
LOG_SHARE = 0.1  # of the time that went by


class FlowProgress:
    """Objects done, kept, failed and left in each of several stages, workers, rate and time to go.

    Parameters
    ----------
    stages
        Names of the stages in order, each with those it waits for.
    stream
        Where it shows; standard error by default.
    clock
        Seconds that pass.
    ticking
        Whether the line is renewed while nothing happens.
    """

    def __init__(
        self,
        stages: Mapping[str, Sequence[str]],
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
        ticking: bool = True,
    ) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty() and os.environ.get("TERM") != "dumb"
        self._clock = clock
        self._begin = clock()
        self._said = -float("inf")
        self._counts: dict[str, Counter[str]] = {stage: Counter() for stage in stages}
        self._to_go = TimeToGo(stages, clock)
        self._workers: tuple[int, int] | None = None
        self._lock = threading.RLock()
        self._closed = threading.Event()
        self._ticking = ticking
        self._ticker: threading.Thread | None = None

    def expect(self, stage: str, object_id: str, seconds: float) -> None:
        """Count an object as left in a stage; its task is expected to take `seconds`."""
        with self._lock:
            self._to_go.expect(stage, object_id, seconds)

    def settle(self, stage: str, object_id: str, outcome: str, seconds: float = 0.0) -> None:
        """Count what became of an object: `COMPUTED`, `KEPT`, `RESTORED` or `FAILED`.

        Parameters
        ----------
        stage
            The stage.
        object_id
            The object, left until now or never.
        outcome
            What became of it.
        seconds
            What its task took, 0 where none ran.
        """
        with self._lock:
            self._counts[stage][KEPT if outcome == RESTORED else outcome] += 1
            self._to_go.settle(stage, object_id, seconds)

    def workers(self, busy: int, total: int) -> None:
        """Note how many workers there are and how many have something to do; shows the line."""
        with self._lock:
            self._workers = busy, total
            self._to_go.workers(busy, total)
        self.show()

    def show(self) -> None:
        """Show the line, if it is time to."""
        with self._lock:
            if self._closed.is_set() or not self._to_go.left():
                return
            if self._ticking and self._ticker is None:
                self._ticker = threading.Thread(target=self._tick, daemon=True)
                self._ticker.start()
            now = self._clock()
            first, last = LOG_INTERVAL_S
            log_interval = min(max(first, LOG_SHARE * (now - self._begin)), last)
            if now - self._said >= (REDRAW_S if self._terminal else log_interval):
                self._said = now
                self._write(self.line(self._columns() - 1 if self._terminal else None))

    def close(self) -> None:
        """Show how it ended, a line a stage."""
        with self._lock:
            if self._closed.is_set():
                return
            self._closed.set()
            seconds = self._clock() - self._begin
            computed = any(counts[COMPUTED] for counts in self._counts.values())
            lines = [f"{stage}: {_counted(counts, 0, all_of=True)}" for stage, counts in self._counts.items()]
            if computed:
                lines[-1] += f" in {duration(seconds)}"
            self._write("\n".join(lines) + ("\n" if self._terminal else ""))
        if self._ticker is not None and self._ticker is not threading.current_thread():
            self._ticker.join()

    def line(self, width: int | None = None) -> str:
        """Return the line as it stands, at most `width` characters of it."""
        left = self._to_go.left_by_stage()
        head = []
        seconds = self._to_go.seconds()
        if seconds is not None:
            head.append(f"{duration(seconds)} to go")
        rate = self._rate()
        if rate:
            head.append(rate)
        if self._workers is not None:
            head.append(f"{self._workers[0]} of {self._workers[1]} workers busy")
        current = [stage for stage in self._counts if left.get(stage)]
        full = [f"{stage}: {_counted(self._counts[stage], left[stage])}" for stage in current]
        short = [f"{stage} {_share(self._counts[stage], left[stage])}" for stage in current]
        text = ""
        for parts in (full, short):
            text = " | ".join(filter(None, [", ".join(head), *parts]))
            if width is None or len(text) <= width:
                return text
        return text[: max(0, width - 1)] + "…" if width is not None else text

    def _rate(self) -> str:
        computed = sum(counts[COMPUTED] for counts in self._counts.values())
        elapsed = self._clock() - self._begin
        if not computed or elapsed <= 0:
            return ""
        for unit, length in (("s", 1.0), ("min", 60.0)):
            if computed / elapsed * length >= 1:
                return f"{computed / elapsed * length:.3g} tasks/{unit}"
        return f"{computed / elapsed * 3600:.3g} tasks/h"

    def _columns(self) -> int:
        try:
            return os.get_terminal_size(self._stream.fileno()).columns or 80
        except (OSError, ValueError):
            return shutil.get_terminal_size((110, 24)).columns

    def _write(self, text: str) -> None:
        # Text first and then the rest of the old line cleared: the line never shows empty.
        clear = "\033[K"
        self._stream.write(
            f"\r{text.replace(chr(10), clear + chr(10))}{clear}" if self._terminal else f"{text}\n"
        )
        self._stream.flush()

    def _tick(self) -> None:
        while not self._closed.wait(TICK_S):
            self.show()


def duration(seconds: float) -> str:
    """Return seconds as a person says them."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    if minutes < 100:
        return f"{minutes:.0f} min"
    hours = minutes / 60
    return f"{hours:.1f} h" if hours < 100 else f"{hours / 24:.1f} days"


def _counted(counts: Counter[str], left: int, all_of: bool = False) -> str:
    """Return the counts of a stage in words; those that are 0 only if `all_of`."""
    named = [(counts[COMPUTED], "done"), (counts[KEPT], "kept"), (counts[FAILED], "failed")]
    words = [f"{number} {word}" for number, word in named if number or all_of]
    return ", ".join([*words, f"{left} left"] if left else words)


def _share(counts: Counter[str], left: int) -> str:
    settled = sum(counts.values())
    failed = f" ({counts[FAILED]} failed)" if counts[FAILED] else ""
    return f"{settled}/{settled + left}{failed}"
