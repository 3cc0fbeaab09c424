"""Whom an exported object is owed to: it travels with every export."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

NOT_KNOWN = "not stated"


@dataclass(frozen=True)
class Credit:
    """Name, source, licence and attribution of an object, as its catalogue has them."""

    object_id: str
    name: str = ""
    source: str = NOT_KNOWN
    licence: str = NOT_KNOWN
    attribution: str = NOT_KNOWN

    @classmethod
    def of_record(cls, object_id: str, record: Mapping[str, Any] | None) -> "Credit":
        """Return what a catalogue row or an Object File's description says; the rest is not stated."""
        known = {
            key: str((record or {}).get(key) or "") for key in ("name", "source", "licence", "attribution")
        }
        name = known.pop("name") or object_id
        return cls(object_id, name, **{key: value or NOT_KNOWN for key, value in known.items()})

    def to_dict(self) -> dict[str, str]:
        """Return the credit as JSON."""
        return asdict(self)

    def to_text(self) -> str:
        """Return the text of ``ATTRIBUTION.txt``."""
        return (
            f"object       {self.name} ({self.object_id})\n"
            f"source       {self.source}\n"
            f"licence      {self.licence}\n"
            f"attribution  {self.attribution}\n"
            "The files of this folder are derived from the object named here; its licence covers them.\n"
        )
