"""The pairs of sounds of a listening test: truth and Object File, struck alike, at one level."""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.dataset import ObjectFolderDataset
from objectfolder.errors import FormatError, InputError
from objectfolder.fidelity.sound import SAMPLE_RATE_HZ
from objectfolder.store import read_attributes
from pipeline.dataset.products import read_fingerprint
from pipeline.dataset.stages import MODES, OBJECT_FILES

FADE_S = 0.01
PEAK = 0.5
LEVEL_RULE = (
    "The Object File's sound is scaled to the root mean square of the truth's; then one factor brings the "
    "larger peak of the two to half of full scale. The last 10 ms fade out; 16 bits."
)


@dataclass(frozen=True)
class Pair:
    """One strike, as both make it sound.

    Parameters
    ----------
    query
        Row of the strike in the product of modes: a held-out point.
    truth, object_file
        (samples,) int16 after levels are matched, see `LEVEL_RULE`.
    level_change_db
        By how much the Object File's sound was made louder to match.
    truth_fingerprint, file_fingerprint
        Of the product of modes and of the Object File.
    """

    object_id: str
    query: int
    truth: np.ndarray
    object_file: np.ndarray
    level_change_db: float
    truth_fingerprint: str
    file_fingerprint: str


def draw_pairs(
    root: Path, count: int, seed: int, *, objects: Sequence[str] | None = None, duration_s: float = 1.0
) -> list[Pair]:
    """Draw strikes at held-out points of a data set: every audible object about as often as the others.

    Parameters
    ----------
    root
        Root of a data set with its modes and Object Files.
    count
        How many; no strike comes twice.
    seed
        Of the draw.
    objects
        Ids; all of the data set if None.

    Raises
    ------
    InputError
        No audible object, too few held-out points, an id that is not there, or a silent strike.
    """
    settings: dict[str, Any] = {
        "objects": objects,
        "duration_s": duration_s,
        "sample_rate_hz": SAMPLE_RATE_HZ,
    }
    truth = ObjectFolderDataset(root, "audio", "held_out", "truth", **settings)
    answer = ObjectFolderDataset(root, "audio", "held_out", "object_file", **settings)
    shared = [object_id for object_id in truth.object_ids if object_id in set(answer.object_ids)]
    places: dict[str, list[int]] = {object_id: [] for object_id in shared if _audible(root, object_id)}
    for index in range(len(truth)):
        object_id, _ = truth.place(index)
        if object_id in places:
            places[object_id].append(index)
    if sum(map(len, places.values())) < count:
        raise InputError(
            str(root),
            f"{sum(map(len, places.values()))} held-out strikes of {len(places)} audible objects for {count}",
            "Ask for fewer trials.",
        )
    chance = random.Random(seed)
    for indices in places.values():
        chance.shuffle(indices)
    order = list(places)
    chance.shuffle(order)
    chosen: list[int] = []
    while len(chosen) < count:
        chosen += [places[object_id].pop() for object_id in order if places[object_id]]
    numbers = {(entry[0], entry[1]): index for index in range(len(answer)) for entry in [answer.place(index)]}
    return [
        _pair(root, truth[index], answer[numbers[truth.place(index)]]) for index in sorted(chosen[:count])
    ]


def match(truth: np.ndarray, answer: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return both sounds as int16 by `LEVEL_RULE`, and the change of the second, dB.

    Raises
    ------
    ValueError
        Silence: it has no level.
    """
    truth, answer = (np.asarray(sound, dtype=np.float64) for sound in (truth, answer))
    levels = [float(np.sqrt(np.mean(sound**2))) for sound in (truth, answer)]
    if not all(levels):
        raise ValueError("silence has no level")
    ratio = levels[0] / levels[1]
    sounds = np.stack([truth, answer * ratio])
    sounds *= PEAK / np.abs(sounds).max()
    fade = min(round(FADE_S * SAMPLE_RATE_HZ), sounds.shape[1])
    sounds[:, sounds.shape[1] - fade :] *= np.linspace(1.0, 0.0, fade)
    levelled = np.round(sounds * 32767).astype("<i2")
    return levelled[0], levelled[1], float(20 * np.log10(ratio))


def _pair(root: Path, truth: dict[str, Any], answer: dict[str, Any]) -> Pair:
    object_id = truth["object_id"]
    try:
        one, other, change = match(truth["sound"].numpy(), answer["sound"].numpy())
    except ValueError as error:
        raise InputError(
            f"{object_id}, query {truth['query']}",
            f"cannot be compared by ear: {error}",
            "Name the other objects, or another --seed.",
        ) from error
    return Pair(
        object_id,
        truth["query"],
        one,
        other,
        change,
        _fingerprint(MODES.path(root, object_id)),
        _fingerprint(OBJECT_FILES.path(root, object_id)),
    )


def _audible(root: Path, object_id: str) -> bool:
    return bool(read_attributes(MODES.path(root, object_id)).get("audible"))


def _fingerprint(path: Path) -> str:
    """Return the fingerprint in a product, empty for a product that the pipeline did not write."""
    try:
        return read_fingerprint(path) or ""
    except FormatError:
        return ""
