"""A row of a table of objects as the rules of a check see it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from objectfolder.audio.materials import Material
from objectfolder.catalogue import ObjectRecord
from objectfolder.errors import InputError
from pipeline.intake.check.finding import Finding
from pipeline.intake.check.shape import Shape


@dataclass(frozen=True)
class Entry:
    """A row, and what is known of its mesh.

    Parameters
    ----------
    object_id
        The row's id; ``line N`` where it has none.
    cells
        Text of every column, known to the factory or not.
    record
        The row as the factory reads it; None for a row with a fault.
    material
        Of the table of materials; None where the row's is not there.
    shape
        What was measured on the mesh; None where it could not be, or was not asked for.
    problem
        Why there is no record, or no shape.
    """

    object_id: str
    cells: Mapping[str, str] = field(default_factory=dict)
    record: ObjectRecord | None = None
    material: Material | None = None
    shape: Shape | None = None
    problem: InputError | None = None

    def cell(self, column: str) -> str:
        """Return a cell; empty where the table has no such column."""
        return self.cells.get(column, "")

    def number(self, column: str) -> float | None:
        """Return a positive number; None for an empty cell or anything else (see the rule `readable`)."""
        try:
            value = float(self.cell(column))
        except ValueError:
            return None
        return value if math.isfinite(value) and value > 0 else None

    @property
    def names(self) -> str:
        """Id and name."""
        return f"{self.object_id} {self.cell('name')}"

    @property
    def is_unfetched(self) -> bool:
        """Whether all that is wrong is that the object's files are not fetched yet."""
        return self.problem is not None and self.problem.remedy.startswith("objectfolder fetch ")

    def found(self, rule: str, severity: str, column: str, found: str, remedy: str) -> Finding:
        """Return a finding of this row."""
        return Finding(severity, self.object_id, column, rule, found, remedy)
