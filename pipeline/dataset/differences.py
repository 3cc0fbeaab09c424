"""Which parts of two fingerprints differ: the reason why a product is not what the inputs ask for."""

from collections.abc import Iterator, Mapping
from typing import Any

import pydantic

ABSENT = "absent"
# Their values are digests, which say nothing to people.
DIGESTS = ("input", "code", "mesh", "texture", "source file", "upstream")


@pydantic.dataclasses.dataclass(frozen=True)
class Reason:
    """One reason why a product is not what is wanted; a `note` says what else is known.

    Parameters
    ----------
    kind
        A value of `SECTIONS`, or one of `pipeline.audit.reasons`.
    name
        Which one, dotted; a module for code, a stage and what is read of it for upstream.
    old, new
        Values, digests for files and code; ``absent`` for a missing one; None where they say nothing.
    """

    kind: str
    name: str = ""
    old: Any = None
    new: Any = None
    note: str = ""

    @pydantic.computed_field
    def text(self) -> str:
        """In words."""
        return str(self)

    def __str__(self) -> str:
        words = f"{self.kind} {self.name}".strip()
        if self.kind in DIGESTS:
            words += " is new" if self.old == ABSENT else " is gone" if self.new == ABSENT else " changed"
        elif self.old is not None or self.new is not None:
            words += f" {_shown(self.old)} -> {_shown(self.new)}"
        return f"{words} ({self.note})" if self.note else words


SECTIONS = {
    "inputs": "input",
    "parameters": "parameter",
    "record": "record",
    "code": "code",
    "packages": "package",
    "seed": "seed",
    "task": "task",
}


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[Reason]:
    """Return what differs between what a product was made from and what is wanted, in JSON values."""
    reasons = []
    for section, part in SECTIONS.items():
        before, after = (dict(_flat("", parts.get(section, {}))) for parts in (old, new))
        for name in sorted({*before, *after}):
            before_value, after_value = before.get(name, ABSENT), after.get(name, ABSENT)
            if before_value != after_value:
                reasons.append(Reason(part, name, before_value, after_value))
    return reasons


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested mappings by dotted names."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flat(f"{name}.{key}" if name else key, inner)
    else:
        yield name, value


def _shown(value: Any) -> str:
    """Return a value as a short text: it may come from an untrusted file."""
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
