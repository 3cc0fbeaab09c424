"""Markers printed on a gel as a regular grid of dots, as a part of a sensor."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from objectfolder.errors import FormatError

MOST_MARKERS = 1000  # along a side


@dataclass(frozen=True)
class MarkerGrid:
    """Dots evenly apart in rows and columns, as the camera sees them on the untouched gel.

    Lengths are those in the plane of the gel's apex, at its magnification.

    Parameters
    ----------
    rows, columns
        How many; a real gel may lack some of the dots.
    row_pitch_m, column_pitch_m
        From one row to the next, and from one column to the next.
    rotation_deg
        Counterclockwise in the picture.
    offset_down_m, offset_right_m
        Of the grid's middle from that of the picture.
    dot_radius_m
        Of a dot.

    Raises
    ------
    ValueError
        Not 1 to `MOST_MARKERS` rows and columns, or a pitch or radius that is not above 0.
    """

    rows: int
    columns: int
    row_pitch_m: float
    column_pitch_m: float
    rotation_deg: float
    offset_down_m: float
    offset_right_m: float
    dot_radius_m: float

    def __post_init__(self) -> None:
        if not all(1 <= count <= MOST_MARKERS for count in (self.rows, self.columns)):
            raise ValueError(f"markers: {self.rows} x {self.columns} are not 1 to {MOST_MARKERS} a side")
        if not min(self.row_pitch_m, self.column_pitch_m, self.dot_radius_m) > 0:
            raise ValueError("markers: pitches and the dots' radius must be above 0")

    def places_m(self) -> np.ndarray:
        """Return (rows * columns, 2) float64, how far down and right of the picture's middle each dot is."""
        turn = np.radians(self.rotation_deg)
        steps = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        counts, pitch = (self.rows, self.columns), (self.row_pitch_m, self.column_pitch_m)
        along = [
            (np.arange(count) - (count - 1) / 2) * length for count, length in zip(counts, pitch, strict=True)
        ]
        grid = np.stack([part.ravel() for part in np.meshgrid(*along, indexing="ij")], axis=1)
        return np.asarray(grid @ steps + (self.offset_down_m, self.offset_right_m))

    def to_dict(self) -> dict[str, Any]:
        """Return the grid as JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "MarkerGrid":
        """Return the grid that `to_dict` described.

        Raises
        ------
        FormatError
            A key too many or too few.
        """
        try:
            return cls(**values)
        except TypeError as error:
            raise FormatError("sensor", f"its marker grid is none ({error})") from error
