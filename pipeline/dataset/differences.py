"""Which parts of two fingerprints differ: the reason why a product is not what the inputs ask for."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

ABSENT = "absent"


@dataclass(frozen=True)
class Difference:
    """One part that differs.

    Parameters
    ----------
    part
        ``input``, ``parameter``, ``record``, ``code``, ``package``, ``seed`` or ``task``.
    name
        Which one, dotted; a module for code.
    old, new
        Values, digests for inputs and code; ``absent`` for a missing one.
    """

    part: str
    name: str
    old: Any
    new: Any

    def __str__(self) -> str:
        what = f"{self.part} {self.name}".strip()
        if self.part in ("input", "code"):
            if self.old == ABSENT:
                return f"{what} is new"
            return f"{what} is gone" if self.new == ABSENT else f"{what} changed"
        return f"{what} {self.old} -> {self.new}"


SECTIONS = {
    "inputs": "input",
    "parameters": "parameter",
    "record": "record",
    "code": "code",
    "packages": "package",
    "seed": "seed",
    "task": "task",
}


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[Difference]:
    """Return what differs between the parts of two fingerprints, in JSON values.

    Parameters
    ----------
    old
        Of a product, as its provenance holds them.
    new
        As they are wanted.
    """
    found = []
    for section, part in SECTIONS.items():
        before, after = (dict(_flat("", parts.get(section, {}))) for parts in (old, new))
        for name in sorted({*before, *after}):
            was, wanted = before.get(name, ABSENT), after.get(name, ABSENT)
            if was != wanted:
                found.append(Difference(part, name, was, wanted))
    return found


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested mappings by dotted names."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flat(f"{name}.{key}" if name else key, inner)
    else:
        yield name, value
