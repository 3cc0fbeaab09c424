"""A material fitted to strikes of a real bowl, held to other strikes of it."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from bench.reality.row import Aim, Row
from objectfolder.making.recordings.fitting import PAIR_CENTS
from pipeline.publish.queries.requests import FittingOfSound
from pipeline.publish.queries.sound_fit import fit_sounds

Floats = NDArray[np.float64]
FITTED, HELD_OUT = (0, 4), (2, 6)
SOURCE = (
    "strikes and scan of a ceramic bowl in the repository of X. Jin et al., DiffSound, SIGGRAPH 2024, at "
    "d2a97cd (no licence stated: not part of this repository)"
)


def fitted_sound_rows(folder: Path) -> list[Row]:
    """Fit the bowl to two strikes, and its frequencies and decays to two others; see `Row`."""
    fitted, validation = (_fit(folder, strikes) for strikes in (FITTED, HELD_OUT))
    pairs = _common(fitted, validation)
    cents = np.array([1200 * np.log2(b["partial_hz"] / a["partial_hz"]) + a["cents"] for a, b in pairs])
    repeat = np.array([1200 * np.log2(b["partial_hz"] / a["partial_hz"]) for a, b in pairs])
    first = [index == 0 or not _is_pair(pairs[index - 1][0], pair[0]) for index, pair in enumerate(pairs)]
    ratio = np.array([b["decay_per_s"] / a["decay_per_s"] for a, b in pairs])
    apart = np.abs(ratio - 1)[first]
    strikes = f"{len(FITTED)} strikes"
    matched_hz = np.array([row["partial_hz"] for row in validation["matched"]])
    by_hand = _partials_by_hand(folder / "partials.csv")
    listed = _in_common(matched_hz, by_hand)
    frequencies = Row(
        sense="sound",
        thing="ceramic bowl, scanned and struck",
        quantity="frequency of modes below 20 kHz, cents",
        figures={
            "rms": float(np.sqrt(np.mean(cents**2))),
            "worst": float(np.abs(cents).max()),
            "rms before the fit": validation["rms_cents_before"],
            "modes": len(pairs),
            f"matched of {len(by_hand)} partials": float(listed),
            "partials that match no mode": float(len(validation["unmatched_partials_hz"])),
        },
        repeatability=f"{np.sqrt(np.mean(repeat**2)):.1f} cents rms from strikes to others",
        fitted=f"E / rho, Poisson's ratio and wall, to {strikes}",
        held_out=f"{len(HELD_OUT)} other strikes",
        source=SOURCE,
        cpu_s=sum(fitted["seconds"].values()),
        aims=(Aim("rms", most=8.0), Aim(f"matched of {len(by_hand)} partials", least=19.0)),
    )
    decays = Row(
        sense="sound",
        thing="ceramic bowl, scanned and struck",
        quantity=f"decay of {len(apart)} partials, two modes within {PAIR_CENTS:g} cents as one, part of it",
        figures={"median": float(np.median(apart)), "worst": float(apart.max())},
        repeatability="the same: it is strikes against strikes",
        fitted=f"each mode's decay, to {strikes}",
        held_out=f"{len(HELD_OUT)} other strikes",
        source=SOURCE,
        cpu_s=sum(fitted["seconds"].values()) - fitted["seconds"]["solve"],
        aims=(Aim("median", most=0.15),),
    )
    return [frequencies, decays]


def _partials_by_hand(path: Path) -> Floats:
    with path.open(encoding="utf-8", newline="") as lines:
        return np.array([float(row["recorded_hz"]) for row in csv.DictReader(lines)])


def _in_common(some_hz: Floats, others_hz: Floats) -> int:
    """How many frequencies are in both, each counted once, within `PAIR_CENTS`."""
    cents = np.abs(1200 * np.log2(some_hz[:, None] / others_hz))
    rows, columns = linear_sum_assignment(np.minimum(cents, PAIR_CENTS))
    return int((cents[rows, columns] < PAIR_CENTS).sum())


def _fit(folder: Path, strikes: tuple[int, ...]) -> dict[str, Any]:
    files = [*(folder / f"strike_{number}.wav" for number in strikes), folder / "bowl.obj"]
    return fit_sounds(files, FittingOfSound(material="ceramic"))


def _common(
    fitted: dict[str, Any], validation: dict[str, Any]
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Matches of the modes that both have."""
    matches = {row["mode"]: row for row in validation["matched"]}
    return [(row, matches[row["mode"]]) for row in fitted["matched"] if row["mode"] in matches]


def _is_pair(low: dict[str, Any], high: dict[str, Any]) -> bool:
    return bool(1200 * np.log2(high["mode_hz"] / low["mode_hz"]) < PAIR_CENTS)
