"""Where an object's products come from, as rows: fingerprints, seeds, parameters, packages, code, rights."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.publish.report.stored_products import OpenProducts

STAGES = ("objects", "views", "modes", "touches", "encoded", "fidelity")


@dataclass(frozen=True)
class Origin:
    """What one product was made from.

    Parameters
    ----------
    stage
        Kind of product.
    fingerprint, seed
        As text; empty where it names none.
    parameters, packages, code, inputs
        Lines of dotted name and value, sorted.
    """

    stage: str
    fingerprint: str
    seed: str
    parameters: str
    packages: str
    code: str
    inputs: str


def origins(products: OpenProducts) -> list[Origin]:
    """Return the origin of every product that names one, in the order of the pipeline."""
    found = []
    for stage in STAGES:
        attributes = products.attributes(stage)
        provenance = attributes.get("provenance")
        if isinstance(provenance, str):
            provenance = _parsed(provenance)
        if not isinstance(provenance, Mapping):
            continue
        seed = provenance.get("seed")
        found.append(
            Origin(
                stage,
                str(attributes.get("fingerprint") or ""),
                "" if seed is None else str(seed),
                *(_lines(provenance.get(part)) for part in ("parameters", "packages", "code", "inputs")),
            )
        )
    return found


def material(fidelity: Mapping[str, Any]) -> tuple[list[tuple[str, str]], str]:
    """Return the material's numbers, and where they come from, as the fidelity product names them."""
    provenance = fidelity.get("provenance")
    record = provenance.get("record") if isinstance(provenance, Mapping) else None
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
    elif isinstance(value, str):
        yield name, value
    else:
        yield name, json.dumps(value, ensure_ascii=False)


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return None
