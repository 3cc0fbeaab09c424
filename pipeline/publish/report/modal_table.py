"""The modes of an object: what the solver found, what the Object File holds, and how far they are apart."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from objectfolder.fidelity.sounds import cents
from pipeline.dataset.measures import number_at
from pipeline.publish.report.object_products import ObjectProducts


class ModeRow(NamedTuple):
    """One mode of the solver, the Object File's errors against it, and its own; NaN where unknown."""

    frequency_hz: float
    damping_per_s: float
    t60_s: float
    error_cents: float
    damping_error: float  # relative
    solver_error_cents: float


def modal_table(products: ObjectProducts, attributes: Mapping[str, Any]) -> list[ModeRow]:
    """Return a row a mode, from the fidelity product, the Object File and the solved modes."""
    audio = attributes.get("audio")
    truth = audio.get("modes_table") or [] if isinstance(audio, Mapping) else []
    if not truth:
        return []
    frequency, damping, t60 = (
        np.array([number_at(mode, name) for mode in truth], dtype=np.float64)
        for name in ("frequency_hz", "damping_per_s", "t60_s")
    )
    tensors = products.object_file_tensors()
    eigenvalues = _of_length(len(truth), tensors.get("audio.eigenvalues"))
    dampings = _of_length(len(truth), tensors.get("audio.dampings_per_s"))
    frequencies = np.sqrt(np.maximum(eigenvalues - dampings**2, 0)) / (2 * math.pi)
    estimates = None
    with products.reading("modal table"):
        estimates = products.arrays("modes", "error_estimates_cents")["error_estimates_cents"]
    with np.errstate(divide="ignore", invalid="ignore"):  # a mode without damping has no relative error
        errors = cents(frequencies, frequency), dampings / damping - 1
    columns = (frequency, damping, t60, *errors, _of_length(len(truth), estimates))
    return [ModeRow(*map(float, row)) for row in zip(*columns, strict=True)]


def _of_length(count: int, values: np.ndarray | None) -> np.ndarray:
    """Return the values where there is one a mode, else NaN for each."""
    return values if values is not None and values.shape == (count,) else np.full(count, np.nan)
