"""Fidelity of an object in two versions: which measures changed, by how much, and which lost too much."""

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from objectfolder.errors import InputError
from pipeline.dataset.measures import BYTES, OTHERS, REPORTED, Measure

MEASURES = {measure.key: measure for measure in (*REPORTED, *OTHERS, BYTES)}
# How much of each a person would notice: by this, losses of different measures are put in one order.
_NOTICEABLE = {"dB": 1.0, "cents": 5.0, "bytes": 1e5, "": 0.005}


@dataclass(frozen=True)
class FidelityChange:
    """A measure (by its key) of an object (by its later id) in two versions.

    Parameters
    ----------
    before, after
        Its values; None where there is none.
    loss
        By how much it is worse, in its unit; negative where it is better, infinite where it is lost.
    """

    object_id: str
    measure: str
    before: float | None
    after: float | None
    loss: float

    @property
    def weight(self) -> float:
        """The loss in steps that a person would notice."""
        return self.loss / _NOTICEABLE[MEASURES[self.measure].unit]


def changes(
    object_id: str, before: Mapping[str, Any] | None, after: Mapping[str, Any] | None
) -> list[FidelityChange]:
    """Return the measures that differ between attributes of two fidelity products, None for no product."""
    fidelity_changes = []
    for key, measure in MEASURES.items():
        old, new = (None if attributes is None else measure.of(attributes) for attributes in (before, after))
        if old != new:
            fidelity_changes.append(FidelityChange(object_id, key, old, new, _loss(measure, old, new)))
    return fidelity_changes


def _loss(measure: Measure, old: float | None, new: float | None) -> float:
    if old is None:
        return -math.inf
    if new is None:
        return math.inf
    return old - new if measure.higher_is_better else new - old


def worst_first(changes: Iterable[FidelityChange]) -> list[FidelityChange]:
    """Order by how noticeable the loss is, gains last."""
    return sorted(changes, key=lambda change: (-change.weight, change.object_id, change.measure))


def thresholds(texts: Sequence[str]) -> dict[str, float]:
    """Return the largest allowed loss by measure from texts like ``vision.psnr_db=0.5``.

    Raises
    ------
    InputError
        A text of another form, or a measure that is not known; the nearest known one is named.
    """
    limits = {}
    for text in texts:
        key, _, number = text.partition("=")
        if key not in MEASURES:
            (near,) = difflib.get_close_matches(key, MEASURES, 1, 0.0)
            finding = f"no measure {key!r}; the nearest is {near!r}"
            raise InputError(f"--max-loss {text}", finding, f"Known: {', '.join(MEASURES)}.")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or value < 0:
            remedy = f"Write {key}=0.5, in {MEASURES[key].unit or 'its own unit'}."
            raise InputError(
                f"--max-loss {text}", "the allowed loss must be a finite number of at least 0", remedy
            )
        limits[key] = value
    return limits


def exceeded(changes: Iterable[FidelityChange], allowed: Mapping[str, float]) -> list[FidelityChange]:
    """Return the changes that lose more than is allowed."""
    # Sums of decimals: a loss from 0.3 to 0.2 is not more than 0.1.
    return [
        change
        for change in changes
        if change.measure in allowed and change.loss > allowed[change.measure] + 1e-9
    ]
