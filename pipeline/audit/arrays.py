"""How the arrays of two products compare: by the checksums they carry, or read, within what is allowed."""

import fnmatch
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.audit import layouts
from pipeline.audit.descriptions import Description
from pipeline.audit.reproducibility import DIFFERENT, EQUAL, WITHIN, Difference, compare, declared
from pipeline.dataset.tolerances import SAME_BYTES, Tolerance


@dataclass(frozen=True)
class Arrays:
    """Verdicts on the arrays of products.

    Parameters
    ----------
    verdicts
        Array name to `EQUAL`, `WITHIN` or `DIFFERENT`.
    unread
        Products whose arrays carry no checksums of their own and were not read.
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
    quick = layouts.differing(old.listing, new.listing)
    if quick is not None:
        return Arrays({name: DIFFERENT if differs else EQUAL for name, differs in quick.items()})
    before, after = old.arrays, new.arrays
    return Arrays(
        {
            name: EQUAL if before.get(name) == after.get(name) else DIFFERENT
            for name in sorted(before.keys() | after.keys())
        }
    )


def by_reading(old: Path, new: Path, stage: str, tolerances: Mapping[str, Tolerance]) -> Arrays:
    """Compare all arrays and attributes of two products.

    Raises
    ------
    FormatError
        A damaged product.
    """
    found = compare(old, new, stage)
    verdicts = {one.name: judged(one, tolerances) for one in found}
    largest = {one.name: one.largest for one in found if one.verdict != EQUAL and math.isfinite(one.largest)}
    return Arrays(verdicts, largest=largest)


def judged(found: Difference, tolerances: Mapping[str, Tolerance]) -> str:
    """Return the verdict on a difference under tolerances by pattern, the first that fits."""
    if found.verdict == EQUAL:
        return EQUAL
    allowed = next(
        (one for key, one in tolerances.items() if fnmatch.fnmatchcase(found.name, key)), SAME_BYTES
    )
    if allowed == SAME_BYTES or not math.isfinite(found.largest):
        return DIFFERENT
    # Shares are of the array's range; without one, only what is allowed outright counts.
    span = found.largest / found.relative if math.isfinite(found.relative) and found.relative else 0.0
    rms = found.rms * span if span else found.largest
    within = found.largest <= allowed.absolute + allowed.relative * span * (
        1 + 1e-9
    ) and rms <= allowed.absolute + allowed.rms * span * (1 + 1e-9)
    return WITHIN if within else DIFFERENT


def stored_tolerances(stage: str, *found: Description) -> tuple[Mapping[str, Tolerance], bool]:
    """Return the tolerances of the first product that stores any, and whether one does.

    Products from before tolerances were stored are judged by what is declared now.
    """
    for one in found:
        stored = one.provenance.get("tolerances")
        if isinstance(stored, dict):
            try:
                return {str(name): _tolerance(said) for name, said in stored.items()}, True
            except (TypeError, ValueError):
                continue
    return {name: _tolerance(said) for name, said in declared(stage).items()}, False


def _tolerance(said: Mapping[str, Any]) -> Tolerance:
    numbers = {name: float(said.get(name, 0.0)) for name in ("relative", "rms", "absolute")}
    if not all(math.isfinite(value) and value >= 0 for value in numbers.values()):
        raise ValueError(f"no tolerance: {said}")
    return Tolerance(**numbers, because=str(said.get("because", "")))
