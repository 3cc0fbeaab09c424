"""Queries to an Object File and its answers, as a page shows them: pictures, sounds, contacts."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from objectfolder.fidelity.images import psnr_db
from objectfolder.fidelity.sounds import cents
from objectfolder.products.store import Product
from objectfolder.products.tensor_file import read_tensor_file
from pipeline.dataset.measures import number_at
from pipeline.dataset.stages import OBJECT_FILES
from pipeline.publish.report.contacts import Contact, contacts
from pipeline.publish.report.object_products import ObjectProducts
from pipeline.publish.report.pictures import picture_uri
from pipeline.publish.report.sounds import SoundPair, sound_pair

# A score computed from the stored pair is the product's own to rounding.
SAME_DB = 1e-6
IMPULSE = ("x", "y", "z")


class Fact(NamedTuple):
    """A number of a query, with its unit and as many decimals as it is worth."""

    name: str
    value: float | None
    unit: str = ""
    decimals: int = 1


class Seen(NamedTuple):
    """Truth and answer of a held-out view or touch, as data URIs."""

    place: str
    truth: str
    answer: str
    width: int
    height: int
    facts: list[Fact]
    contact: Contact | None = None


class Heard(NamedTuple):
    """Truth and answer of a held-out strike."""

    place: str
    sound: SoundPair
    facts: list[Fact]


class Stored(NamedTuple):
    """A query that the fidelity product stores: its rank, worst first, with truth and answer."""

    rank: int
    place: str
    truth: np.ndarray
    answer: np.ndarray

    def seen(self, facts: list[Fact], contact: Contact | None = None) -> Seen:
        """Return it as a page shows it."""
        height, width = self.truth.shape[:2]
        pictures = picture_uri(self.truth), picture_uri(self.answer)
        return Seen(self.place, *pictures, width, height, facts, contact)


def queries(fidelity: Product, products: ObjectProducts, most: int) -> dict[str, list[Any]]:
    """Return up to `most` views, strikes and touches, as many as the fidelity product stores at most.

    What cannot be read is left out and noted in ``products.unreadable``.
    """
    found: dict[str, list[Any]] = {"views": [], "strikes": [], "touches": []}
    for sense, read in (("views", _views), ("strikes", _strikes), ("touches", _touches)):
        with products.reading(sense):
            found[sense] = read(fidelity, products, most)
    return found


def _stored(fidelity: Product, sense: str, most: int) -> Iterator[Stored]:
    """Yield at most `most` stored queries, evenly spread over the ranks with both ends."""
    if f"{sense}_truth" not in fidelity:
        return
    truth, answer = fidelity[f"{sense}_truth"], fidelity[f"{sense}_answer"]
    if truth.shape != answer.shape:
        raise ValueError(f"{truth.shape} of truth, {answer.shape} of answer")
    count = len(truth)
    for rank in np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int)).tolist():
        place = {0: "worst", count - 1: "best"}.get(rank, f"rank {rank + 1} of {count} stored")
        yield Stored(rank, place if count > 1 else "the only one stored", truth[rank], answer[rank])


def _views(fidelity: Product, products: ObjectProducts, most: int) -> list[Seen]:
    vision = fidelity.attributes.get("vision")
    rows = vision.get("per_view") or [] if isinstance(vision, Mapping) else []
    poses: list[Any] = []
    with products.reading("views"):
        views = products.arrays("views", "held_out", "camera_to_world", "light_position")
        cameras, lights = views["camera_to_world"][:, :3, 3], views["light_position"]
        poses = list(zip(cameras[views["held_out"]], lights[views["held_out"]], strict=True))
    shown = []
    for pair in _stored(fidelity, "vision", most):
        score = psnr_db(pair.truth, pair.answer)
        same = (one for one in rows if abs((number_at(one, "psnr_db") or 0.0) - score) <= SAME_DB)
        row: Mapping[str, Any] = next(same, {})
        facts = [
            Fact("full image", score, "dB"),
            Fact("foreground", number_at(row, "psnr_foreground_db"), "dB"),
            Fact("SSIM", number_at(row, "ssim"), "", 4),
        ]
        view = number_at(row, "view")
        if view is not None and view < len(poses):
            for name, position in zip(("camera", "light"), poses[int(view)], strict=True):
                facts += _pose_facts(name, position)
        shown.append(pair.seen(facts))
    return shown


def _pose_facts(name: str, position: np.ndarray) -> list[Fact]:
    azimuth = float(np.degrees(np.arctan2(position[1], position[0])))
    elevation = float(np.degrees(np.arctan2(position[2], np.hypot(position[0], position[1]))))
    return [Fact(f"{name} azimuth", azimuth, "°", 0), Fact(f"{name} elevation", elevation, "°", 0)]


def _strikes(fidelity: Product, products: ObjectProducts, most: int) -> list[Heard]:
    points = np.zeros((0, 3))
    with products.reading("modes"):
        modes = products.arrays("modes", "points", "held_out")
        points = modes["points"][modes["held_out"]]
    shown = []
    for rank, _, truth, answer in _stored(fidelity, "strike", most):
        sound = sound_pair(truth, answer)
        facts = [Fact("difference", sound.difference_db, "dB of the truth's energy")]
        place = f"strike {rank + 1}"
        if rank < len(points):
            facts += [Fact(axis, 1e3 * float(x), "mm") for axis, x in zip(IMPULSE, points[rank], strict=True)]
            place = f"1 N s along {IMPULSE[rank % 3]}"
        shown.append(Heard(place, sound, facts))
    return shown


def _touches(fidelity: Product, products: ObjectProducts, most: int) -> list[Seen]:
    stored = list(_stored(fidelity, "touch", most))
    found: list[Contact | None] = [None] * len(stored)
    if stored:
        with products.reading("contacts"):
            found = contacts(np.stack([pair.truth for pair in stored]), products)
    shown = []
    for pair, contact in zip(stored, found, strict=True):
        facts = [Fact("whole image", psnr_db(pair.truth, pair.answer), "dB")]
        for name, value, unit in contact.labels if contact else []:
            facts.append(Fact(name, value, unit, 2 if name == "depth" else 1))
        shown.append(pair.seen(facts, contact))
    return shown


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
    tensors: Mapping[str, np.ndarray] = {}
    with products.reading(OBJECT_FILES.name):
        tensors = read_tensor_file(products.path(OBJECT_FILES.name)).tensors
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
