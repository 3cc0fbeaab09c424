"""The page of one object, and whether the one that is there still shows what is known."""

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import jinja2

from objectfolder.fidelity.contacts import PIXELS
from objectfolder.products.provenance import canonical_json
from objectfolder.products.regular_file import open_regular
from objectfolder.products.store import Product
from pipeline.dataset import measures
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.measures import number_at
from pipeline.dataset.records import SAFE_ID
from pipeline.dataset.stages import OBJECT_FILES
from pipeline.dataset.verified import Verified
from pipeline.publish.report.measured_objects import MeasuredObject
from pipeline.publish.report.object_products import SUFFIXES, ObjectProducts
from pipeline.publish.report.pictures import no_picture
from pipeline.publish.report.summary import definitions_of, error_words, setting_words, split
from pipeline.publish.report.templates import security_policy, template_environment
from pipeline.publish.viewer.static import PAGE as PLAYER_SCRIPTS

SENSE_NAMES = {"vision": "Sight", "audio": "Sound", "touch": "Touch"}
SCRIPTS = ("object.js",)
SPECTROGRAM_MARKS = (("100 Hz", 100.0), ("1 kHz", 1000.0), ("10 kHz", 10000.0))
# The fingerprint stands in the first bytes of a page.
HEAD_BYTES = 4096
OBJECTS = "objects"  # folder of the pages beside the first
PAGE, PLAYER = ".html", ".player.js"
# Arrays of the fidelity product that are files beside the page, by their suffixes.
SHEETS = {
    "vision_sheet": ".views.webp",
    "touch_sheet": ".touches.webp",
    "touch_sides": ".sides.webp",
}
STRIKES = ".strikes.js"
PLAYER_STYLE = b'href="player.css"'
_FINGERPRINT = re.compile(rb'<meta name="fingerprint" content="([0-9a-f]{64})">')


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
    pairs
        Held-out queries of each sense, at most.
    verified
        Knows the digests of products that have not changed since the last report; None where the page's
        fingerprint is not asked.
    """

    subject: MeasuredObject
    data: Path
    previous: str
    next: str
    failures: Sequence[FailedObject]
    pairs: int
    verified: Verified | None

    @property
    def products(self) -> ObjectProducts:
        """The products of the object."""
        return ObjectProducts(self.data, self.subject.stored_name)

    @cached_property
    def player(self) -> str:
        """Name of the script of its player's data beside the page; empty where there is no Object File."""
        object_id = self.subject.object_id
        has_player = SAFE_ID.fullmatch(object_id) and self.products.path(OBJECT_FILES.name).is_file()
        return f"{object_id}{PLAYER}" if has_player else ""

    def beside(self, suffix: str) -> str:
        """Return the name of a file of `tile`."""
        return page_name(self.subject.object_id).removesuffix(PAGE) + suffix

    @cached_property
    def fingerprint(self) -> str:
        """A hash of all that the page is made from: products, costs, neighbours, code of reports."""
        subject = self.subject
        assert self.verified is not None
        parts = {
            "products": self.products.digests(self.verified),
            "stages": [[stage, repr(subject.cost(stage))] for stage in subject.stages],
            "queries": subject.efforts,
            "beside": [self.previous, self.next, list(map(repr, self.failures)), self.player, self.pairs],
            "code": code_digest(),
        }
        return hashlib.sha256(canonical_json(parts).encode()).hexdigest()

    @property
    def tile(self) -> tuple[str, ...]:
        """Suffixes of the files beside the page: pictures, and its strikes where it rings."""
        audible = self.subject.part("audio").get("audible") is True
        return (".webp", *SHEETS.values(), *([".wav", STRIKES] if audible else []))

    def render(self, fingerprint: str, player: str, findings: Sequence[str]) -> tuple[str, dict[str, bytes]]:
        """Return the page as HTML that carries `fingerprint`, and the files of `tile` by suffix.

        Parameters
        ----------
        player
            Name of the script of the player's data; empty for a page without a player.
        findings
            What was left out, beside what cannot be read here.
        """
        products = self.products
        with products.opened:
            subject, environment = self.subject, _environment()
            fidelity, modes = Product({}), []
            with products.reading("fidelity"):
                fidelity = products.arrays("fidelity")
            from pipeline.publish.report.queries import modal_table, queries  # of a page that is drawn

            own_queries = queries(fidelity, products, self.pairs)
            with products.reading("modal table"):
                modes = modal_table(products, subject.attributes)
            beside = dict.fromkeys(self.tile, b"")
            for name, suffix in {"turntable": ".webp", **SHEETS}.items():
                beside[suffix] = (fidelity[name] if name in fidelity else no_picture()).tobytes()
            with products.reading("strikes"):
                if ".wav" in beside:
                    from pipeline.publish.report.sounds import short_sound

                    beside[".wav"] = short_sound(fidelity)
                    beside[STRIKES] = own_queries["strikes"].script if own_queries["strikes"] else b""
            page = environment.get_template("object.html.j2").render(
                page=self,
                player=player,
                record=subject,
                queries=own_queries,
                modes=modes,
                origins=_origins(products),
                filling=_filling(subject, products),
                collision=_collision(products),
                unreadable=list(dict.fromkeys([*products.unreadable, *findings])),
                fingerprint=fingerprint,
                policy=security_policy(environment, SCRIPTS),
            )
            return page, beside


def page_name(object_id: str) -> str:
    """Return the file name of an object's page; an id that is no file name is hashed."""
    if SAFE_ID.fullmatch(object_id):
        return f"{object_id}{PAGE}"
    return f"_{hashlib.sha256(object_id.encode()).hexdigest()[:16]}{PAGE}"


def shown_fingerprint(page: Path) -> tuple[str | None, bool]:
    """Return the fingerprint in a page, None for a page without one, and whether it has a player."""
    try:
        with open_regular(page) as file:
            head = file.read(HEAD_BYTES)
    except FileNotFoundError:
        return None, False
    findings = _FINGERPRINT.search(head)
    return findings[1].decode() if findings else None, PLAYER_STYLE in head


def _collision(products: ObjectProducts) -> str:
    """Return how the convex parts fit, or why there are none; empty where there is no product."""
    with products.reading("collision"):
        statement = products.attributes("collision")
        if not statement:
            return ""
        if statement["absent"] is not None:
            return f"none, for {statement['absent']}"
        return (
            f"{statement['parts']} convex, {100 * statement['union_iou']:.0f} % of the volume in solid or "
            f"parts is in both, and none sticks out by more than {1000 * statement['outward_m']:.1f} mm."
        )
    return ""


def _filling(subject: MeasuredObject, products: ObjectProducts) -> dict[str, float | None] | None:
    """Return volume (m^3), change and uncertainty of the solid that is heard of an open surface."""
    volume = number_at(subject.attributes, "body.filled_volume_m3")
    if subject.part("body").get("watertight") is not False or volume is None:
        return None
    stated = products.attributes("modes")
    change = number_at(stated, "discretisation.volume_error")
    uncertainty = number_at(stated, "discretisation.volume_uncertainty")
    return None if change is None else {"volume_m3": volume, "change": change, "uncertainty": uncertainty}


def _origins(products: ObjectProducts) -> list[dict[str, Any]]:
    """Return stage, fingerprint and provenance of every product that names what it was made from."""
    findings = []
    for kind in [kind for kind in SUFFIXES if kind != OBJECT_FILES.name]:
        attributes = products.attributes(kind)
        stated = attributes.get("provenance")
        with products.reading(f"provenance of {kind}"):
            stated = json.loads(stated) if isinstance(stated, str) else stated
            if isinstance(stated, Mapping):
                findings.append(
                    {"stage": kind, "fingerprint": attributes.get("fingerprint"), "stated": stated}
                )
    return findings


def _material(fidelity: Mapping[str, Any]) -> tuple[Mapping[str, Any], str, str]:
    """Return the material's numbers, and where they and its loss factor come from, as fidelity names them."""
    stated = fidelity.get("provenance")
    record = stated.get("record") if isinstance(stated, Mapping) else None
    if not isinstance(record, Mapping):
        return {}, "", ""
    material = record.get("material")
    citation, loss_citation = (str(record.get(name) or "") for name in ("material_citation", "loss_citation"))
    return material if isinstance(material, Mapping) else {}, citation, loss_citation


@cache
def _environment() -> jinja2.Environment:
    from pipeline.publish.report.sounds import spectrogram_share

    environment = template_environment(PLAYER_SCRIPTS)
    environment.filters |= {
        "page_name": page_name,
        "setting": lambda row: setting_words(row["setting"], row["value"], row["value"]),
        "error": lambda row: error_words(row["error_unit"]),
        "lines": lambda value: json.dumps(value, indent=1, sort_keys=True, ensure_ascii=False),
    }
    environment.globals |= {
        "contact_pixels": PIXELS,
        "definitions_of": definitions_of,
        "material_of": _material,
        "measures": measures,
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
    root = Path(__file__).parents[2]
    files = sorted(path for name in ("report", "viewer") for path in (root / "publish" / name).rglob("*"))
    files += [root / "dataset/measures.py", root / "publish/cards/licences.py"]
    content = {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if path.suffix in {".py", ".j2", ".css", ".js"}
    }
    return hashlib.sha256(canonical_json(content).encode()).hexdigest()
