"""What a person sees of a running stage: one line while it runs, a summary and a table of failures."""

import shutil
import sys
import textwrap
import time
from collections.abc import Mapping, Sequence
from typing import TextIO

from pipeline.flow_progress import duration
from pipeline.task import Failure, Outcome

QUIET_INTERVAL_S = 15.0  # between lines where the output is no terminal


class Progress:
    """The line of a stage: objects done, kept, failed and left, and the time to go.

    Parameters
    ----------
    stage
        Name of the stage.
    kept
        Objects that needed nothing.
    failed
        Objects that failed before any task ran.
    expected
        Expected seconds of each object to do.
    """

    def __init__(
        self, stage: str, kept: int, failed: int, expected: Mapping[str, float], stream: TextIO = sys.stderr
    ) -> None:
        self._stage = stage
        self._kept = kept
        self._failed = failed
        self._expected = dict(expected)
        self._total = sum(expected.values())
        self._done = 0
        self._stream = stream
        self._begin = time.monotonic()
        self._said = 0.0
        if expected:
            self._say(self.line(), end=False)

    def add(self, outcome: Outcome) -> None:
        """Count an outcome and show the line."""
        self._expected.pop(outcome.object_id, None)
        if outcome.failure is None:
            self._done += 1
        else:
            self._failed += 1
        due = time.monotonic() - self._said > QUIET_INTERVAL_S and self._expected
        if self._stream.isatty() or due:
            self._say(self.line(), end=False)

    def close(self) -> None:
        """Show how it ended."""
        seconds = time.monotonic() - self._begin
        text = f"{self._stage}: {self._done} done, {self._kept} kept, {self._failed} failed"
        self._say(f"{text} in {duration(seconds)}" if self._done else text, end=True)

    def line(self) -> str:
        """Return the line as it stands."""
        left = len(self._expected)
        text = f"{self._stage}: {self._done} done, {self._kept} kept, {self._failed} failed, {left} left"
        finished = self._total - sum(self._expected.values())
        if left and finished > 0:
            pace = (time.monotonic() - self._begin) / finished
            text += f", {duration(pace * sum(self._expected.values()))} to go"
        return text

    def _say(self, text: str, end: bool) -> None:
        self._said = time.monotonic()
        if self._stream.isatty():
            self._stream.write(f"\r\033[K{text}" + ("\n" if end else ""))
        else:
            self._stream.write(f"{text}\n")
        self._stream.flush()


def failure_table(failures: Sequence[Failure], width: int | None = None) -> str:
    """Return failures as a table of object, error and remedy; empty without any."""
    if not failures:
        return ""
    width = width or shutil.get_terminal_size((110, 24)).columns
    first = min(32, max(6, *(len(failure.object_id) for failure in failures)))
    rest = max(24, (width - first - 4) // 2)
    lines = [f"{'object':<{first}}  {'error':<{rest}}  remedy"]
    for failure in failures:
        cells = (
            textwrap.wrap(failure.object_id, first) or [""],
            textwrap.wrap(failure.error, rest) or [""],
            textwrap.wrap(failure.remedy, rest) or [""],
        )
        for row in range(max(map(len, cells))):
            name, error, remedy = (cell[row] if row < len(cell) else "" for cell in cells)
            lines.append(f"{name:<{first}}  {error:<{rest}}  {remedy}".rstrip())
    return "\n".join(lines)
