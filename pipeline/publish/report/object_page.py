"""The page of one object, and whether the one that is there still shows what is known."""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple

import jinja2

from objectfolder.provenance import canonical_json
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.measures import BYTE_PARTS, HEADLINE, number_at
from pipeline.dataset.records import SAFE_ID
from pipeline.publish.report.measured_objects import MeasuredObject
from pipeline.publish.report.modal_table import ModeRow, modal_table
from pipeline.publish.report.object_products import ObjectProducts
from pipeline.publish.report.pictures import thumbnail
from pipeline.publish.report.provenance import Origin, material, origins
from pipeline.publish.report.queries import Queries, queries
from pipeline.publish.report.sounds import spectrogram_share
from pipeline.publish.report.summary import definitions_of, split
from pipeline.publish.report.templates import security_policy, template_environment

SENSE_NAMES = {"vision": "Sight", "audio": "Sound", "touch": "Touch"}
SCRIPTS = ("theme.js", "object.js")
SPECTROGRAM_MARKS = (("100 Hz", 100.0), ("1 kHz", 1000.0), ("10 kHz", 10000.0))
# The fingerprint stands in the first bytes of a page.
HEAD_BYTES = 4096
PLAYER_STYLE = b'href="player.css"'
_FINGERPRINT = re.compile(rb'<meta name="fingerprint" content="([0-9a-f]{64})">')


class Filling(NamedTuple):
    """The solid that is heard of an open surface: its volume against what the surface encloses."""

    volume_m3: float
    change: float
    uncertainty: float | None


@dataclass
class Content:
    """What a page shows of the products of its object; `unreadable` names the omitted products, and why."""

    queries: Queries = field(default_factory=Queries)
    modes: Sequence[ModeRow] = ()
    origins: Sequence[Origin] = ()
    filling: Filling | None = None
    thumbnail: bytes = b""
    unreadable: Sequence[str] = ()


@dataclass(frozen=True)
class ObjectPage:
    """What the page of one object is made from.

    Parameters
    ----------
    subject
        The object.
    data
        Folder of the stages' folders.
    previous, next
        Ids of the objects before and after it in the order of ids; empty at an end.
    failures
        Of this object.
    player
        Name of the script of its player's data beside the page; empty for no player.
    pairs
        Held-out queries of each sense, at most.
    """

    subject: MeasuredObject
    data: Path
    previous: str
    next: str
    failures: Sequence[FailedObject]
    player: str
    pairs: int

    def fingerprint(self) -> str:
        """Return a hash of all that the page is made from: products, costs, neighbours, code of reports."""
        subject = self.subject
        parts = {
            "products": self._products().digests(),
            "stages": [[stage, repr(subject.cost(stage))] for stage in subject.stages],
            "queries": subject.efforts,
            "beside": [self.previous, self.next, list(map(repr, self.failures)), self.player, self.pairs],
            "code": code_digest(),
        }
        return hashlib.sha256(canonical_json(parts).encode()).hexdigest()

    def read(self) -> Content:
        """Read what the page shows of the products."""
        subject, content = self.subject, Content()
        with self._products() as products:
            content.queries = queries(products, subject.attributes, self.pairs)
            with products.reading("modal table"):
                content.modes = modal_table(products, subject.attributes)
            content.origins = origins(products)
            content.filling = _filling(subject, products)
            content.thumbnail = thumbnail(None)
            fidelity = products.get("fidelity")
            with products.reading("views"):
                if fidelity is not None and "vision_truth" in fidelity:
                    content.thumbnail = thumbnail(fidelity.array("vision_truth"))
        content.unreadable = list(dict.fromkeys(products.unreadable))
        return content

    def render(self, content: Content, fingerprint: str) -> str:
        """Return the page as HTML that carries `fingerprint`."""
        environment = _environment()
        return environment.get_template("object.html.j2").render(
            page=self,
            record=self.subject,
            content=content,
            fingerprint=fingerprint,
            policy=security_policy(environment, SCRIPTS),
        )

    def _products(self) -> ObjectProducts:
        return ObjectProducts(self.data, self.subject.stored_name)


def page_name(object_id: str) -> str:
    """Return the file name of an object's page; an id that is no file name is hashed."""
    if SAFE_ID.fullmatch(object_id):
        return f"{object_id}.html"
    return f"_{hashlib.sha256(object_id.encode()).hexdigest()[:16]}.html"


def shown_fingerprint(page: Path) -> tuple[str | None, bool]:
    """Return the fingerprint in a page, None for a page without one, and whether it has a player."""
    try:
        with page.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except FileNotFoundError:
        return None, False
    found = _FINGERPRINT.search(head)
    return found[1].decode() if found else None, PLAYER_STYLE in head


def _filling(subject: MeasuredObject, products: ObjectProducts) -> Filling | None:
    if subject.part("body").get("watertight") is not False:
        return None
    volume = number_at(subject.attributes, "body.filled_volume_m3")
    modes = products.attributes("modes")
    change = number_at(modes, "discretisation.volume_error")
    if volume is None or change is None:
        return None
    return Filling(volume, change, number_at(modes, "discretisation.volume_uncertainty"))


@cache
def _environment() -> jinja2.Environment:
    environment = template_environment()
    environment.filters["page_name"] = page_name
    environment.globals |= {
        "byte_parts": BYTE_PARTS,
        "definitions_of": definitions_of,
        "headline": HEADLINE,
        "material_of": material,
        "sense_names": SENSE_NAMES,
        "spectrogram_marks": [
            (text, round(104 - 100 * spectrogram_share(hertz), 1)) for text, hertz in SPECTROGRAM_MARKS
        ],
        "split_of": split,
        "value": number_at,
    }
    return environment


@cache
def code_digest() -> str:
    """Return a hash of the modules, templates and scripts that pages and their players are made by."""
    root = Path(__file__).parents[1]
    suffixes = {".py", ".j2", ".css", ".js"}
    files = [path for name in ("report", "viewer") for path in (root / name).rglob("*")]
    content = {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if path.suffix in suffixes
    }
    return hashlib.sha256(canonical_json(content).encode()).hexdigest()
