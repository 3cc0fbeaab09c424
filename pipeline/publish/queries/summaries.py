"""What queries of an Object File were answered with, in figures; ``str`` words them in a line."""

from dataclasses import dataclass
from typing import Literal

from pipeline.dataset.counts import counted


@dataclass(frozen=True, kw_only=True)
class SampleSummary:
    """Queries that were drawn: numbers of views and of contacts."""

    folder: str
    views: int
    contacts: int

    def __str__(self) -> str:
        points = f"points.npy and forces.npy {self.contacts, 3} (1 N s inwards)"
        return f"{self.folder}: views.npy {self.views, 6}, {points}"


@dataclass(frozen=True, kw_only=True)
class RenderSummary:
    """Images and their sizes in pixels; lights that were given for all of them."""

    folder: str
    images: int
    height: int
    width: int
    passes: tuple[str, ...]
    lights: int
    turntable: bool

    def __str__(self) -> str:
        if self.turntable:
            return f"{self.folder}: {counted(self.images, 'picture')} from all round, and turntable.gif"
        lights = f", {counted(self.lights, 'light')}" if self.lights else ""
        passes = f" with {', '.join(self.passes)}" if self.passes else ""
        size = f"{self.height} x {self.width} pixels"
        return f"{self.folder}: {counted(self.images, 'image')} of {size}{passes}{lights}"


@dataclass(frozen=True, kw_only=True)
class StrikeSummary:
    """Sounds, their length, and the peak of all in `unit`, before the gain by which they were written."""

    folder: str
    sounds: int
    duration_s: float
    sample_rate_hz: int
    peak: float
    unit: Literal["m/s", "Pa"]
    gain: float
    gain_by_peak: bool

    def __str__(self) -> str:
        hint = f" (--gain 1 keeps {self.unit})" if self.gain_by_peak and self.peak > 0 else ""
        gain = "" if self.gain == 1 else f", written times {self.gain:.3g}{hint}"
        peak = f"peak {self.peak:.3g} {self.unit}"
        return f"{self.folder}: {counted(self.sounds, 'sound')} of {self.duration_s} s, {peak}{gain}"


@dataclass(frozen=True, kw_only=True)
class PressSummary:
    """Touches, and how many of them the sensor reaches."""

    folder: str
    touches: int
    reachable: int

    def __str__(self) -> str:
        hint = " (labels.json says which; without a file --points draws such)"
        more = "" if self.reachable == self.touches else hint
        return f"{self.folder}: {counted(self.touches, 'touch')}, {self.reachable} reachable{more}"
