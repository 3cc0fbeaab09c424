"""What one way of finding the modes of a body came to, and how far it is from a reference."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

MAX_FREQUENCY_HZ = 20000.0
MAX_MODES = 256  # looked for at most below it


@dataclass
class Outcome:
    """Modes found, and what they took.

    Attributes
    ----------
    frequencies_hz : (k,) undamped eigenfrequencies, ascending, rigid motions left out
    unknowns : size of the eigenproblem
    cpu_s : CPU seconds by step, children included
    notes : what else is worth a line of the table
    """

    frequencies_hz: np.ndarray
    unknowns: int
    cpu_s: dict[str, float]
    notes: dict[str, Any] = field(default_factory=dict)

    @property
    def total_cpu_s(self) -> float:
        return sum(self.cpu_s.values())


def compare(answer: np.ndarray, reference: np.ndarray, limit_hz: float = MAX_FREQUENCY_HZ) -> dict[str, Any]:
    """Errors of the audible modes, matched in ascending order, as many as both have.

    Sorted order is the matching: two lists of the same body differ by less than a mode's distance to its
    neighbours, or by more than any matching could mend.
    """
    audible, true = answer[answer < limit_hz], reference[reference < limit_hz]
    count = min(len(answer), len(true))
    if count == 0:
        return {"modes": len(audible), "modes_of_reference": len(true)}
    cents = 1200 * np.log2(answer[:count] / true[:count])
    return {
        "modes": len(audible),
        "modes_of_reference": len(true),
        "compared": count,
        "first_error_percent": float(100 * (answer[0] / true[0] - 1)),
        "median_cents": float(np.median(np.abs(cents))),
        "worst_cents": float(np.abs(cents).max()),
        "mean_cents": float(cents.mean()),
        "cents": np.round(cents, 3).tolist(),
    }
