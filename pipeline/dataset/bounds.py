"""The range, unit and meaning of a number that people write: checked where it is read, and documented."""

from dataclasses import dataclass
from typing import Any

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema


@dataclass(frozen=True)
class Bounds:
    """A number from `least` to `most`, both ends included; metadata of an annotated field of pydantic.

    Parameters
    ----------
    least, most
        In `unit`. Beyond them there is no such thing, or it fits no machine.
    unit
        Empty for a pure number.
    meaning
        What the number is, for the documentation.
    """

    least: float
    most: float
    unit: str = ""
    meaning: str = ""

    def __str__(self) -> str:
        return f"{self.least} to {self.most} {self.unit}".rstrip()

    def check(self, value: float) -> float:
        """Return a value of the range; raise ValueError for another, also for what is not a number."""
        if not self.least <= value <= self.most:
            raise ValueError(f"It must be from {self}")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Check what pydantic has found to be of the annotated type."""
        return core_schema.no_info_after_validator_function(self.check, handler(source))
