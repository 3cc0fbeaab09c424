"""Where an object's products come from, as rows: fingerprints, seeds, parameters, packages, code, rights."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from pipeline.dataset.stages import STAGES
from pipeline.publish.report.object_products import ObjectProducts

KINDS = tuple(stage.products[-1].name for stage in STAGES.values())


class Origin(NamedTuple):
    """What one product was made from, as text; the last four are lines of dotted names and values."""

    stage: str
    fingerprint: str
    seed: str
    parameters: str
    packages: str
    code: str
    inputs: str


def origins(products: ObjectProducts) -> list[Origin]:
    """Return the origin of every product that names one, in the order of the pipeline."""
    found = []
    for stage in KINDS:
        attributes = products.attributes(stage)
        stated = attributes.get("provenance")
        with products.reading(f"provenance of {stage}"):
            stated = json.loads(stated) if isinstance(stated, str) else stated
            if isinstance(stated, Mapping):
                seed = "" if stated.get("seed") is None else str(stated["seed"])
                lines = (_lines(stated.get(part)) for part in ("parameters", "packages", "code", "inputs"))
                found.append(Origin(stage, str(attributes.get("fingerprint") or ""), seed, *lines))
    return found


def material(fidelity: Mapping[str, Any]) -> tuple[list[tuple[str, str]], str]:
    """Return the material's numbers, and where they come from, as the fidelity product names them."""
    stated = fidelity.get("provenance")
    record = stated.get("record") if isinstance(stated, Mapping) else None
    if not isinstance(record, Mapping):
        return [], ""
    return list(_flat(record.get("material") or {})), str(record.get("material_citation") or "")


def _lines(value: Any) -> str:
    return "\n".join(f"{name}: {text}" for name, text in _flat(value or {}))


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Yield the leaves of nested mappings under dotted names; lists are values."""
    if isinstance(value, Mapping):
        for key in sorted(value, key=str):
            yield from _flat(value[key], f"{name}.{key}" if name else str(key))
    else:
        yield name, value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
