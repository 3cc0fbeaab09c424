"""How the arrays of two products compare: by the checksums they carry, or read, within what is allowed."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.audit.descriptions import GROUP, Description
from pipeline.audit.reproducibility import DIFFERENT, EQUAL, compare
from pipeline.dataset.stage import Stage
from pipeline.dataset.tolerances import Tolerance


@dataclass(frozen=True)
class Arrays:
    """Verdicts on the arrays of products.

    Parameters
    ----------
    verdicts
        Array name to `EQUAL`, `WITHIN` or `DIFFERENT`.
    unread
        Number of products whose arrays carry no checksums of their own and were not read.
    largest
        Array name to the largest difference, in the array's unit, where it was read and is not equal.
    """

    verdicts: Mapping[str, str] = field(default_factory=dict)
    unread: int = 0
    largest: Mapping[str, float] = field(default_factory=dict)

    def __add__(self, other: "Arrays") -> "Arrays":
        return Arrays(
            {**self.verdicts, **other.verdicts}, self.unread + other.unread, {**self.largest, **other.largest}
        )

    def count(self) -> Mapping[str, int]:
        """Return how many there are of each verdict."""
        return Counter(self.verdicts.values())


def by_checksums(old: Description, new: Description) -> Arrays:
    """Compare the arrays of two archives by the checksums of their chunks; no array is read.

    Two CRC-32 of different chunks of one size are equal once in four thousand million times, unless
    somebody wants them to be.

    Raises
    ------
    ValueError
        The list of entries of either is damaged.
    """
    before, after = old.chunks, new.chunks
    differing = {entry[2] for entry in before ^ after}
    names = ({entry[2] for entry in before} | differing) - {GROUP.encode()}
    return Arrays({name.decode(): DIFFERENT if name in differing else EQUAL for name in sorted(names)})


def by_reading(old: Path, new: Path, tolerances: Mapping[str, Tolerance]) -> Arrays:
    """Compare all arrays and attributes of two products, under tolerances by pattern of their names.

    Raises
    ------
    FormatError
        A damaged product.
    """
    found = compare(old, new, tolerances)
    largest = {one.name: one.largest for one in found if one.verdict != EQUAL and math.isfinite(one.largest)}
    return Arrays({one.name: one.verdict for one in found}, largest=largest)


def stored_tolerances(stage: Stage, *found: Description) -> tuple[Mapping[str, Tolerance], bool]:
    """Return the tolerances of the first product that stores any, and whether one does.

    Products from before tolerances were stored are judged by what is declared now.
    """
    for one in found:
        stored = one.provenance.get("tolerances")
        if isinstance(stored, dict):
            try:
                return {str(name): _tolerance(said) for name, said in stored.items()}, True
            except (TypeError, ValueError, AttributeError):
                continue
    return stage.tolerances, False


def _tolerance(said: Mapping[str, Any]) -> Tolerance:
    numbers = {name: float(said.get(name, 0.0)) for name in ("relative", "rms", "absolute")}
    if not all(math.isfinite(value) and value >= 0 for value in numbers.values()):
        raise ValueError(f"no tolerance: {said}")
    return Tolerance(**numbers, because=str(said.get("because", "")))
