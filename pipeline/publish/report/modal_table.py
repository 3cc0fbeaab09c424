"""The modes of an object: what the solver found, what the Object File holds, and how far they are apart."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.fidelity.sounds import cents
from pipeline.dataset.measures import number_at
from pipeline.publish.report.object_products import ObjectProducts


@dataclass(frozen=True)
class ModeRow:
    """One mode; None where a number is not known.

    Parameters
    ----------
    frequency_hz, damping_per_s, t60_s
        Of the truth: the solver's.
    error_cents
        Object File against the truth, 1200 log2 of the ratio.
    damping_error
        Object File against the truth, relative.
    solver_error_cents
        Estimated error of the truth itself.
    """

    frequency_hz: float | None
    damping_per_s: float | None
    t60_s: float | None
    error_cents: float | None
    damping_error: float | None
    solver_error_cents: float | None


def modal_table(products: ObjectProducts, attributes: Mapping[str, Any]) -> list[ModeRow]:
    """Return a row a mode, from the fidelity product, the Object File and the solved modes."""
    audio = attributes.get("audio")
    truth = audio.get("modes_table") or [] if isinstance(audio, Mapping) else []
    tensors = products.object_file_tensors()
    frequencies, dampings = _of_file(tensors, len(truth))
    estimates = _estimates(products, len(truth))
    rows = []
    for index, mode in enumerate(truth):
        frequency, damping = number_at(mode, "frequency_hz"), number_at(mode, "damping_per_s")
        error = damping_error = None
        if frequencies is not None and frequency and frequencies[index] > 0:
            error = float(cents(frequencies[[index]], np.array([frequency]))[0])
        if dampings is not None and damping:
            damping_error = float(dampings[index] / damping - 1)
        estimate = (
            float(estimates[index]) if estimates is not None and np.isfinite(estimates[index]) else None
        )
        rows.append(ModeRow(frequency, damping, number_at(mode, "t60_s"), error, damping_error, estimate))
    return rows


def _of_file(tensors: Mapping[str, np.ndarray], count: int) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return frequencies and dampings that the Object File stores; None where they are not one a mode."""
    eigenvalues, dampings = tensors.get("audio.eigenvalues"), tensors.get("audio.dampings_per_s")
    if eigenvalues is None or dampings is None or eigenvalues.shape != (count,) or dampings.shape != (count,):
        return None, None
    return np.sqrt(np.maximum(eigenvalues - dampings**2, 0)) / (2 * math.pi), dampings


def _estimates(products: ObjectProducts, count: int) -> np.ndarray | None:
    modes = products.get("modes")
    if modes is None or not count or "error_estimates_cents" not in modes:
        return None
    try:
        estimates = modes.array("error_estimates_cents")
    except FormatError as error:
        products.unreadable.append(f"modes: {error.finding}")
        return None
    return estimates if estimates.shape == (count,) else None
