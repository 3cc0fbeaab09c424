"""Limits of a solution: CPU time, memory of factors, memory of blocks of vectors."""

import time
from dataclasses import dataclass

from objectfolder.errors import SimulationError

VECTOR_SHARE, FACTORS = 1 / 3, 2 / 3
"""Of the memory, at most: where one takes its share the other is far below it."""


@dataclass(frozen=True)
class Limits:
    """What a solution may take.

    Attributes
    ----------
    memory_gb : of the process, 1e9 bytes
    ends_s : CPU time of the process, by `time.process_time`, at which it is given up
    """

    memory_gb: float = float("inf")
    ends_s: float = float("inf")

    @classmethod
    def from_now(cls, memory_gb: float, seconds: float) -> "Limits":
        """Limits of a solution that begins now."""
        return cls(memory_gb, time.process_time() + seconds)

    @property
    def factor_bytes(self) -> float:
        """Memory of one factorisation."""
        return 1e9 * FACTORS * self.memory_gb

    @property
    def vector_values(self) -> float:
        """Numbers of 8 bytes in the blocks of vectors of an iteration."""
        return 1e9 * VECTOR_SHARE * self.memory_gb / 8

    def check_time(self) -> None:
        """Raise `SimulationError` when the time is over: another machine may get further."""
        if time.process_time() > self.ends_s:
            remedy = "Lower max_frequency_hz, or state a longer time_limit_s"
            raise SimulationError("modes", "solving took more than its time limit", remedy)


NO_LIMITS = Limits()
