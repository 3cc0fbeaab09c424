"""Queries to an Object File and its answers, as a page shows them: pictures, sounds, contacts."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.fidelity.images import psnr_db
from pipeline.dataset.measures import number_at
from pipeline.publish.report.archive import Archive
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
    """Truth and answer of a held-out view or touch."""

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


@dataclass(frozen=True)
class Queries:
    """All that a page shows of an object's senses."""

    views: list[Seen] = field(default_factory=list)
    strikes: list[Heard] = field(default_factory=list)
    touches: list[Seen] = field(default_factory=list)


def queries(products: ObjectProducts, attributes: Mapping[str, Any], pairs: int) -> Queries:
    """Return up to `pairs` queries a sense, as many as the fidelity product stores at most.

    What cannot be read is left out and noted in ``products.unreadable``.

    Parameters
    ----------
    attributes
        Of the fidelity product.
    """
    fidelity = products.get("fidelity")
    if fidelity is None:
        return Queries()

    def safely(what: str, read: Callable[[], list[Any]]) -> list[Any]:
        with products.reading(what):
            return read()
        return []

    found = safely("contacts", lambda: _contacts(fidelity, products))
    return Queries(
        safely("views", lambda: _views(fidelity, products.get("views"), attributes, pairs)),
        safely("strikes", lambda: _strikes(fidelity, products.get("modes"), pairs)),
        safely("touches", lambda: _touches(fidelity, found, pairs)),
    )


class Stored(NamedTuple):
    """A query that the fidelity product stores: its rank, worst first, out of `of`, with truth and answer."""

    rank: int
    of: int
    truth: np.ndarray
    answer: np.ndarray

    def seen(self, facts: list[Fact], contact: Contact | None = None) -> Seen:
        """Return it as a page shows it."""
        place = f"rank {self.rank + 1} of {self.of} stored"
        if self.of == 1:
            place = "the only one stored"
        elif self.rank in (0, self.of - 1):
            place = "best" if self.rank else "worst"
        height, width = self.truth.shape[:2]
        return Seen(place, picture_uri(self.truth), picture_uri(self.answer), width, height, facts, contact)


def _stored(fidelity: Archive, sense: str, most: int) -> list[Stored]:
    truth_name, answer_name = f"{sense}_truth", f"{sense}_answer"
    if truth_name not in fidelity or answer_name not in fidelity:
        return []
    truth, answer = fidelity.array(truth_name), fidelity.array(answer_name)
    if truth.shape != answer.shape:
        raise FormatError(str(fidelity.path), f"{sense}: {truth.shape} of truth, {answer.shape} of answer")
    chosen = _evenly(len(truth), most)
    return [Stored(rank, len(truth), truth[rank], answer[rank]) for rank in chosen]


def _evenly(count: int, most: int) -> list[int]:
    """Return at most `most` of `count` places, evenly spread with both ends."""
    places: list[int] = np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int)).tolist()
    return places


def _views(fidelity: Archive, views: Archive | None, attributes: Mapping[str, Any], most: int) -> list[Seen]:
    vision = attributes.get("vision")
    rows = vision.get("per_view") or [] if isinstance(vision, Mapping) else []
    order = np.argsort([number_at(row, "psnr_db") or 0.0 for row in rows], kind="stable")
    poses = _poses(views) if views else None
    shown = []
    for pair in _stored(fidelity, "vision", most):
        score = psnr_db(pair.truth, pair.answer)
        ranks = _evenly(len(rows), pair.of)
        row = rows[order[ranks[pair.rank]]] if pair.rank < len(ranks) else {}
        if abs((number_at(row, "psnr_db") or 0.0) - score) > SAME_DB:
            row = {}  # another rule chose what is stored: nothing more is known of this view
        facts = [
            Fact("full image", score, "dB"),
            Fact("foreground", number_at(row, "psnr_foreground_db"), "dB"),
            Fact("SSIM", number_at(row, "ssim"), "", 4),
        ]
        view = number_at(row, "view")
        if poses is not None and view is not None and view < len(poses[0]):
            facts += _pose_facts("camera", poses[0][int(view)]) + _pose_facts("light", poses[1][int(view)])
        shown.append(pair.seen(facts))
    return shown


def _poses(views: Archive) -> tuple[np.ndarray, np.ndarray]:
    """Return where cameras and lights of the held-out views stand, in the unit frame."""
    held_out = views.array("held_out")
    return views.array("camera_to_world")[held_out, :3, 3], views.array("light_position")[held_out]


def _pose_facts(name: str, position: np.ndarray) -> list[Fact]:
    azimuth = float(np.degrees(np.arctan2(position[1], position[0])))
    elevation = float(np.degrees(np.arctan2(position[2], np.hypot(position[0], position[1]))))
    return [Fact(f"{name} azimuth", azimuth, "°", 0), Fact(f"{name} elevation", elevation, "°", 0)]


def _strikes(fidelity: Archive, modes: Archive | None, most: int) -> list[Heard]:
    pairs = _stored(fidelity, "strike", most)
    points = modes.array("points")[modes.array("held_out")] if modes and pairs else np.zeros((0, 3))
    shown = []
    for rank, _, truth, answer in pairs:
        sound = sound_pair(truth, answer)
        facts, place = (
            [Fact("difference", sound.difference_db, "dB of the truth's energy")],
            f"strike {rank + 1}",
        )
        if rank < len(points):
            axes = zip(IMPULSE, points[rank], strict=True)
            facts += [Fact(axis, 1e3 * float(value), "mm") for axis, value in axes]
            place = f"1 N s along {IMPULSE[rank % 3]}"
        shown.append(Heard(place, sound, facts))
    return shown


def _contacts(fidelity: Archive, products: ObjectProducts) -> list[Contact | None]:
    touches, objects = products.get("touches"), products.get("objects")
    if touches is None or objects is None or "touch_truth" not in fidelity:
        return []
    return contacts(fidelity, touches, objects)


def _touches(fidelity: Archive, found: Sequence[Contact | None], most: int) -> list[Seen]:
    shown = []
    for pair in _stored(fidelity, "touch", most):
        contact = found[pair.rank] if pair.rank < len(found) else None
        facts = [Fact("whole image", psnr_db(pair.truth, pair.answer), "dB")]
        for name, value, unit in contact.labels if contact else []:
            facts.append(Fact(name, value, unit, 2 if name == "depth" else 1))
        shown.append(pair.seen(facts, contact))
    return shown
