"""The page of one object, and whether the one that is there still shows what is known."""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jinja2

from objectfolder.provenance import canonical_json
from pipeline.dataset.measures import BYTE_PARTS, HEADLINE, number_at
from pipeline.dataset.records import SAFE_ID
from pipeline.publish.report.costs import Costs
from pipeline.publish.report.modal_table import ModeRow, modal_table
from pipeline.publish.report.object_records import PRODUCT_SUFFIX, Failure, Record
from pipeline.publish.report.queries import queries
from pipeline.publish.report.sounds import spectrogram_share
from pipeline.publish.report.stated_versions import Origin, material, origins
from pipeline.publish.report.stored_products import OpenProducts, Shelf
from pipeline.publish.report.summary import definitions_of, split
from pipeline.publish.report.tables import speed_error_rows
from pipeline.publish.report.templates import security_policy, template_environment

SENSE_NAMES = {"vision": "Sight", "audio": "Sound", "touch": "Touch"}
SCRIPTS = ("theme.js", "object.js")
SPECTROGRAM_MARKS = (("100 Hz", 100.0), ("1 kHz", 1000.0), ("10 kHz", 10000.0))
# The fingerprint stands in the first bytes of a page.
HEAD_BYTES = 4096
PLAYER_STYLE = b'href="player.css"'
_FINGERPRINT = re.compile(rb'<meta name="fingerprint" content="([0-9a-f]{64})">')


@dataclass(frozen=True)
class Neighbourhood:
    """What a page shows besides its own object.

    Parameters
    ----------
    previous, next
        Ids of the objects before and after it in the order of ids; empty at an end.
    failures
        Of this object.
    player
        Name of the script of its player's data beside the page; empty for no player.
    """

    previous: str = ""
    next: str = ""
    failures: tuple[Failure, ...] = ()
    player: str = ""


def page_name(object_id: str) -> str:
    """Return the file name of an object's page; an id that is no file name is hashed."""
    if SAFE_ID.fullmatch(object_id):
        return f"{object_id}.html"
    return f"_{hashlib.sha256(object_id.encode()).hexdigest()[:16]}.html"


def stored_name(record: Record) -> str:
    """Return the name that an object's products have on disk."""
    return record.path.name.removesuffix(PRODUCT_SUFFIX)


def fingerprint(record: Record, shelf: Shelf, costs: Costs, around: Neighbourhood, pairs: int) -> str:
    """Return a hash of all that a page is made from: products, costs, neighbours and the code of reports."""
    parts = {
        "products": shelf.digests(stored_name(record)),
        "stages": [(stage, asdict(cost) if cost else None) for stage, cost in _stages(record, costs)],
        "queries": speed_error_rows([record], costs),
        "around": asdict(around),
        "pairs": pairs,
        "code": code_digest(),
    }
    return hashlib.sha256(canonical_json(parts).encode()).hexdigest()


def shown_fingerprint(page: Path) -> tuple[str | None, bool]:
    """Return the fingerprint that a page carries, None where there is none, and whether it has a player."""
    try:
        with page.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except FileNotFoundError:
        return None, False
    found = _FINGERPRINT.search(head)
    return found[1].decode() if found else None, PLAYER_STYLE in head


def render_object(
    record: Record,
    shelf: Shelf,
    costs: Costs,
    around: Neighbourhood,
    pairs: int,
    made_of: str,
    problem: str = "",
) -> str:
    """Return the page of an object.

    Parameters
    ----------
    pairs
        Held-out queries a sense, at most.
    made_of
        Its fingerprint.
    problem
        What else of the object is left out, and why.
    """
    attributes = record.attributes
    environment = _environment()
    with OpenProducts(shelf, stored_name(record)) as products:
        shown = queries(products, attributes, pairs)
        modes: list[ModeRow] = []
        with products.reading("modal table"):
            modes = modal_table(products, attributes)
        found: list[Origin] = []
        with products.reading("provenance"):
            found = origins(products)
        filling = _filling(record, products)
        unreadable = list(dict.fromkeys([*products.unreadable, problem] if problem else products.unreadable))
    numbers, citation = material(attributes)
    return environment.get_template("object.html.j2").render(
        record=record,
        fingerprint=made_of,
        policy=security_policy(environment, SCRIPTS),
        player=around.player,
        previous=around.previous,
        next=around.next,
        failures=around.failures,
        unreadable=unreadable,
        warnings=_warnings(record),
        filling=filling,
        headline=[(m, m.of(attributes), m.trivial_of(attributes)) for m in HEADLINE],
        extents_mm=_extents_mm(record),
        mass_kg=number_at(attributes, "body.mass_kg"),
        total_bytes=number_at(attributes, "bytes.total"),
        queries=shown,
        modes=modes,
        spectrogram_marks=[
            (text, round(104 - 100 * spectrogram_share(hertz), 1)) for text, hertz in SPECTROGRAM_MARKS
        ],
        stages=_stages(record, costs),
        efforts=speed_error_rows([record], costs),
        byte_parts=BYTE_PARTS,
        origins=found,
        material=numbers,
        citation=citation,
        definitions=definitions_of([record]),
        split=split([record]),
        sense_names=SENSE_NAMES,
        value=number_at,
    )


def _stages(record: Record, costs: Costs) -> list[tuple[str, Any]]:
    return [
        (stage, costs.stage(record.object_id, stage, record.fingerprints))
        for stage in costs.stage_names({record.object_id})
    ]


def _warnings(record: Record) -> list[str]:
    said: Any = record.sense("body").get("warnings")
    return [text for text in said if isinstance(text, str)] if isinstance(said, list) else []


@dataclass(frozen=True)
class _Filling:
    """The solid that is heard of an open surface: its volume against what the surface encloses."""

    volume_m3: float
    change: float
    uncertainty: float | None


def _filling(record: Record, products: OpenProducts) -> _Filling | None:
    if record.sense("body").get("watertight") is not False:
        return None
    volume = number_at(record.attributes, "body.filled_volume_m3")
    modes = products.attributes("modes")
    change = number_at(modes, "discretisation.volume_error")
    if volume is None or change is None:
        return None
    return _Filling(volume, change, number_at(modes, "discretisation.volume_uncertainty"))


def _extents_mm(record: Record) -> list[float]:
    extents: Any = record.sense("body").get("extents_m")
    if not isinstance(extents, Sequence) or isinstance(extents, str):
        return []
    return [1e3 * float(length) for length in extents if isinstance(length, int | float)]


@cache
def _environment() -> jinja2.Environment:
    environment = template_environment()
    environment.filters["page_name"] = page_name
    return environment


@cache
def code_digest() -> str:
    """Return a hash of the modules, templates and scripts that pages and their players are made by."""
    root = Path(__file__).parents[1]
    suffixes = {".py", ".j2", ".css", ".js"}
    files = [
        path for name in ("report", "viewer") for path in (root / name).rglob("*") if path.suffix in suffixes
    ]
    content: Mapping[str, str] = {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files
    }
    return hashlib.sha256(canonical_json(content).encode()).hexdigest()
