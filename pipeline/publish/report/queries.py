"""Queries to an Object File and its answers, as a page shows them: pictures, sounds, contacts."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from objectfolder.fidelity.sheets import SHEET_PIXELS
from objectfolder.fidelity.sounds import cents
from objectfolder.products.store import Product
from objectfolder.products.tensor_file import read_tensor_file
from pipeline.dataset.measures import (
    CONTACT,
    FOREGROUND,
    FULL_IMAGE,
    SIMILARITY,
    WHOLE_TOUCH,
    Measure,
    number_at,
)
from pipeline.dataset.stages import OBJECT_FILES
from pipeline.publish.report.object_products import ObjectProducts
from pipeline.publish.report.pictures import picture_uri
from pipeline.publish.report.sounds import strikes_script
from pipeline.publish.report.templates import number

AXES = ("x", "y", "z")


class Fact(NamedTuple):
    """A number of a query, with its unit and as many decimals as it is worth."""

    name: str
    value: float | None
    unit: str = ""
    decimals: int = 1

    @classmethod
    def of(cls, name: str, measure: Measure, row: Mapping[str, Any]) -> "Fact":
        """Return a measure of one view or touch, whose row has it by its own name."""
        return cls(name, number_at(row, measure.name), measure.unit, measure.decimals)


class Contact(NamedTuple):
    """Where a touch was made: (x, y) pixels of the object's picture from a side, `PIXELS` a side.

    Parameters
    ----------
    side
        Which picture, from the top of the file with all.
    visible
        Whether the contact point is in sight.
    spot, arrow
        The contact point, and where the arrow along the outward normal begins.
    gel
        Corners of the gel's plane at its apex, as an SVG polygon's points.
    """

    side: int
    visible: bool
    spot: list[float]
    arrow: list[float]
    gel: str


class Seen(NamedTuple):
    """A held-out view or touch: what is known of it, and truth and answer as data URIs where they are stored.

    Parameters
    ----------
    rank
        Among those shown, from the worst.
    row
        Of the sheet.
    """

    rank: int
    place: str
    row: int
    facts: list[Fact]
    contact: Contact | None = None
    truth: str = ""
    answer: str = ""


class Gallery(NamedTuple):
    """Every held-out view or touch, worst first, and the size of their pictures."""

    items: list[Seen]
    height: int
    width: int

    @property
    def stored(self) -> list[Seen]:
        """Those with pictures of their own."""
        return [item for item in self.items if item.truth]

    def others(self) -> dict[str, Any]:
        """Return what a page's script needs to show those on the sheet, as JSON, by rank."""
        return {
            str(item.rank): {
                "place": item.place,
                "row": item.row,
                "facts": [
                    (fact.name, number(fact.value, fact.decimals), fact.unit)
                    for fact in item.facts
                    if fact.value is not None
                ],
                "contact": item.contact and item.contact._asdict(),
            }
            for item in self.items
            if not item.truth
        }


class Strikes(NamedTuple):
    """How many strikes are held out, how many of them sound, and the script that has them, worst first."""

    held_out: int
    audible: int
    script: bytes


def queries(fidelity: Product, products: ObjectProducts, most: int) -> dict[str, Any]:
    """Return every held-out query of each sense, up to `most` of them with lossless pictures.

    What cannot be read is left out and noted in ``products.unreadable``.
    """
    contents: dict[str, Any] = {"views": None, "strikes": None, "touches": None}
    with products.reading("views"):
        contents["views"] = _views(fidelity, products, most)
    with products.reading("strikes"):
        contents["strikes"] = _strikes(fidelity, products)
    with products.reading("touches"):
        contents["touches"] = _touches(fidelity, products, most)
    return contents


def _spread(count: int, most: int) -> list[int]:
    """Return at most `most` of `count` ranks, evenly with both ends."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int)).tolist()


def _stored(fidelity: Product, sense: str) -> tuple[np.ndarray, np.ndarray] | None:
    if f"{sense}_truth" not in fidelity:
        return None
    truth, answer = fidelity[f"{sense}_truth"], fidelity[f"{sense}_answer"]
    if truth.shape != answer.shape:
        raise ValueError(f"{truth.shape} of truth, {answer.shape} of answer")
    return truth, answer


def _gallery(fidelity: Product, sense: str, facts: list[list[Fact]], score: str, most: int) -> Gallery | None:
    """Return the held-out queries of a sense ranked by the fact `score`, those without it last.

    The stored pictures are of ranks spread evenly over those with a score, as a verification spreads them.
    """
    pairs = _stored(fidelity, sense)
    if pairs is None or not len(pairs[0]):
        return None
    height, width, _ = pairs[0].shape[1:]
    facts = facts or [[] for _ in pairs[0]]
    scores = [next((fact.value for fact in own if fact.name == score), None) for own in facts]
    keys = [math.inf if score is None else score for score in scores]
    order = sorted(range(len(facts)), key=keys.__getitem__)
    rank_count = len(facts) - scores.count(None) or len(facts)
    sample = _spread(rank_count, len(pairs[0]))
    places = {sample[index]: index for index in _spread(len(sample), most)}
    on_sheet = SHEET_PIXELS // height if f"{sense}_sheet" in fidelity else 0
    items: list[Seen] = []
    for rank, row in enumerate(order):
        place = {0: "worst", rank_count - 1: "best"}.get(rank, "" if rank < rank_count else "no contact")
        own = [picture_uri(pair[places[rank]]) for pair in pairs] if rank in places else []
        if own or row < on_sheet:
            items.append(Seen(len(items), place, row, facts[row], None, *own))
    return Gallery(items, height, width)


def _table(fidelity: Product, sense: str, name: str) -> list[Mapping[str, Any]]:
    part = fidelity.attributes.get(sense)
    rows = part.get(name) if isinstance(part, Mapping) else None
    return rows or []


def _views(fidelity: Product, products: ObjectProducts, most: int) -> Gallery | None:
    rows = _table(fidelity, "vision", "per_view")
    facts = [
        [
            Fact.of("full image", FULL_IMAGE, row),
            Fact.of("foreground", FOREGROUND, row),
            Fact.of("SSIM", SIMILARITY, row),
        ]
        for row in rows
    ]
    with products.reading("views"):
        views = products.arrays("views", "held_out", "camera_to_world", "light_position")
        cameras, lights = views["camera_to_world"][:, :3, 3], views["light_position"]
        held_out = views["held_out"]
        for own, camera, light in zip(facts, cameras[held_out], lights[held_out], strict=True):
            own += [*_pose_facts("camera", camera), *_pose_facts("light", light)]
    return _gallery(fidelity, "vision", facts, "full image", most)


def _pose_facts(name: str, position: np.ndarray) -> list[Fact]:
    azimuth = float(np.degrees(np.arctan2(position[1], position[0])))
    elevation = float(np.degrees(np.arctan2(position[2], np.hypot(position[0], position[1]))))
    return [Fact(f"{name} azimuth", azimuth, "°", 0), Fact(f"{name} elevation", elevation, "°", 0)]


def _strikes(fidelity: Product, products: ObjectProducts) -> Strikes | None:
    if "strike_truth" not in fidelity:
        return None
    differences_db = fidelity["strike_difference_db"]
    count, points_m = len(differences_db), np.zeros((0, 3))
    with products.reading("modes"):
        modes = products.arrays("modes", "points", "held_out")
        points = modes["points"][modes["held_out"]]
        if points.shape != (count, 3):
            raise ValueError(f"{points.shape} points of {count} strikes")
        points_m = points
    script = strikes_script(fidelity, points_m)
    return Strikes(count, int((~np.isnan(differences_db)).sum()), script)


def _touches(fidelity: Product, products: ObjectProducts, most: int) -> Gallery | None:
    rows = _table(fidelity, "touch", "per_touch")
    facts = [
        [Fact.of("contact region", CONTACT, row), Fact.of("whole image", WHOLE_TOUCH, row)] for row in rows
    ]
    gallery = _gallery(fidelity, "touch", facts, "contact region", most)
    if gallery is None:
        return None
    contents: list[tuple[Contact, list[Fact]]] = []
    with products.reading("contacts"):
        contents = list(zip(_contacts(fidelity), _labels(products), strict=True))
    if len(contents) != len(rows):
        return gallery
    items = [
        item._replace(contact=contents[item.row][0], facts=[*item.facts, *contents[item.row][1]])
        for item in gallery.items
    ]
    return gallery._replace(items=items)


def _contacts(fidelity: Product) -> list[Contact]:
    flags = (fidelity[f"touch_{name}"].tolist() for name in ("side", "visible"))
    pixels = fidelity["touch_pixels"].astype(np.float64).reshape(-1, 6, 2).round(1).tolist()
    return [
        Contact(side, visible, spot, arrow, " ".join(f"{x},{y}" for x, y in gel))
        for side, visible, (spot, arrow, *gel) in zip(*flags, pixels, strict=True)
    ]


def _labels(products: ObjectProducts) -> list[list[Fact]]:
    """Return what is known of each held-out touch."""
    names = ("points", "depth_m", "tilt_deg", "contact_area_m2")
    touches = products.arrays("touches", "held_out", *names)
    columns = (touches[name][touches["held_out"]].tolist() for name in names)
    return [
        [
            *(Fact(axis, 1e3 * value, "mm") for axis, value in zip(AXES, point, strict=True)),
            Fact("depth", 1e3 * depth, "mm", 2),
            Fact("tilt", tilt, "°"),
            Fact("contact area", 1e6 * area, "mm²"),
        ]
        for point, depth, tilt, area in zip(*columns, strict=True)
    ]


class ModeRow(NamedTuple):
    """One mode of the solver, the Object File's errors against it, and its own; NaN where unknown."""

    frequency_hz: float
    damping_per_s: float
    t60_s: float
    loss_factor: float  # NaN where it does not ring
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
    natural = np.hypot(2 * math.pi * np.where(frequency > 0, frequency, np.nan), damping)
    loss_factor = 2 * damping / natural
    columns = (frequency, damping, t60, loss_factor, *errors, _of_length(len(truth), estimates))
    return [ModeRow(*map(float, row)) for row in zip(*columns, strict=True)]


def _of_length(count: int, values: np.ndarray | None) -> np.ndarray:
    """Return the values where there is one a mode, else NaN for each."""
    return values if values is not None and values.shape == (count,) else np.full(count, np.nan)
