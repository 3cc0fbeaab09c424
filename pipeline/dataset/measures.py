"""The measures a report is about: key, direction, unit, target, trivial answer and print of each.

It is the one registry: pages, summaries and descriptions go by these constants, not by keys of their own.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SENSES = ("vision", "audio", "touch")
NOTHING = "\N{EN DASH}"
MINUS = "\N{MINUS SIGN}"


def number(value: Any, decimals: int = 1) -> str:
    """Return a number with a fixed count of decimals and a true minus sign; a dash for None."""
    if value is None or not math.isfinite(value):
        return NOTHING
    text = f"{float(value):,.{decimals}f}".replace(",", "\u202f")
    return text.replace("-", MINUS) if float(f"{value:.{decimals}f}") else text.lstrip("-")


def megabytes(size: Any) -> str:
    """Return bytes in MB (a million bytes), in whole kB below one."""
    if size is None:
        return NOTHING
    return f"{number(size / 1e3, 0)} kB" if size < 999_500 else f"{number(size / 1e6, 2)} MB"


@dataclass(frozen=True)
class Measure:
    """One number of an object's fidelity.

    Attributes
    ----------
    key : where it stands in the attributes of a fidelity product, ``"sense.name"``
    label : how it is called
    unit, decimals : how it is printed
    higher_is_better : direction; decides which object is the worst
    target : what the factory promises of the data set's mean
    trivial : name, beside `key`, of the score of an answer that knows nothing of the object
    noise_floor : name, beside `key`, of the best score that the noise of the truth lets any answer have
    occasional : stated only where some object has it, as a parameter of the data set asks
    column, column_unit : how a table of objects calls it, where that is shorter; and its unit there
    summary : how the last lines of a run call it, of a headline figure
    """

    key: str
    label: str
    unit: str = "dB"
    decimals: int = 1
    higher_is_better: bool = True
    target: float | None = None
    trivial: str | None = None
    noise_floor: str | None = None
    occasional: bool = False
    column: str = ""
    column_unit: str = "dB"
    summary: str = ""

    @property
    def sense(self) -> str:
        """First part of the key."""
        return self.key.partition(".")[0]

    @property
    def name(self) -> str:
        """Last part of the key."""
        return self.key.partition(".")[2]

    def of(self, attributes: Mapping[str, Any]) -> float | None:
        """Return the measure's value in the attributes of a fidelity product, None where it has none."""
        return number_at(attributes, self.key)

    def trivial_of(self, attributes: Mapping[str, Any]) -> float | None:
        """Return the score of the trivial answer; None for a measure without one."""
        return number_at(attributes, f"{self.sense}.{self.trivial}") if self.trivial else None

    def text(self, value: float | None) -> str:
        """Return a value as pages print it, without its unit unless that is bytes."""
        return megabytes(value) if self.unit == "bytes" else number(value, self.decimals)

    def text_of(self, attributes: Mapping[str, Any]) -> str:
        """Return `text` of the measure's value in the attributes of a fidelity product."""
        return self.text(self.of(attributes))

    @property
    def target_text(self) -> str:
        """The target with its direction."""
        size = (
            megabytes(self.target)
            if self.unit == "bytes"
            else number(self.target, 3 if self.decimals > 1 else 0)
        )
        return f"{'≥' if self.higher_is_better else '≤'} {size}"

    def worst(self, values: list[float]) -> float:
        """Return the worst of one or more values."""
        return min(values) if self.higher_is_better else max(values)

    def margin(self, value: float) -> float:
        """Return by how much `value` is better than the target (negative: worse)."""
        assert self.target is not None
        return value - self.target if self.higher_is_better else self.target - value

    def noise_floor_of(self, attributes: Mapping[str, Any]) -> float | None:
        """Return the noise floor of the truth; None for a measure without one."""
        return number_at(attributes, f"{self.sense}.{self.noise_floor}") if self.noise_floor else None


def number_at(attributes: Mapping[str, Any], key: str) -> float | None:
    """Return the finite number at a dotted key of nested attributes, else None."""
    value: Any = attributes
    for part in key.split("."):
        # A dictionary first: the check of an abstract class takes most of a report's look at a number.
        value = value.get(part) if isinstance(value, dict | Mapping) else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:  # JSON bounds no whole number
        return None
    return number if math.isfinite(number) else None


FOREGROUND = Measure(
    "vision.psnr_foreground_db",
    "View, PSNR of the foreground",
    target=32.0,
    trivial="trivial_psnr_foreground_db",
    column="View, foreground",
    summary="Sight:        PSNR of the foreground, held-out views,",
)
# Beside the headline figure of sight: published data sets print this one.
FULL_IMAGE = Measure(
    "vision.psnr_db",
    "View, PSNR of the full image",
    target=40.0,
    trivial="trivial_psnr_db",
    column="View, full image",
)
SIMILARITY = Measure(
    "vision.ssim",
    "View, structural similarity",
    unit="",
    decimals=4,
    target=0.985,
    trivial="trivial_ssim",
    column="View",
    column_unit="SSIM",
)
GAIN = Measure(
    "audio.gain_error_db",
    "Modal gain",
    higher_is_better=False,
    target=-26.0,
    column="Gain error",
    summary="Sound:        gain error at held-out points",
)
SOLVER_ERROR = Measure(
    "audio.solver_error_estimate_cents", "Solver's own error, estimated", unit="cents", higher_is_better=False
)
WHOLE_TOUCH = Measure("touch.psnr_db", "Touch, whole image", trivial="empty_psnr_db")
CONTACT = Measure(
    "touch.psnr_contact_db",
    "Touch, contact region",
    target=42.0,
    trivial="empty_psnr_contact_db",
    column="Touch, contact",
    summary="Touch:        PSNR in contact, held-out touches,",
)
# Of views in other conditions, which `vision.condition_views` asks for: see `vision.truth.conditions`.
CONDITION_LABELS = {
    "128_px": "128 px, lamp at 1",
    "256_px": "256 px",
    "512_px": "512 px",
    "near_lamp": "lamp at 0.6",
    "far_lamp": "lamp at 3",
    "window": "in a window's light",
    "sky": "under the sky",
}
IN_CONDITIONS = tuple(
    Measure(
        f"vision.psnr_{name}_db",
        f"View, foreground, {label}",
        trivial=f"trivial_psnr_{name}_db",
        noise_floor=f"noise_floor_{name}_db",
        occasional=True,
    )
    for name, label in CONDITION_LABELS.items()
)
REPORTED = (
    FOREGROUND,
    FULL_IMAGE,
    SIMILARITY,
    *IN_CONDITIONS,
    Measure(
        "audio.frequency_error_cents", "Modal frequency", unit="cents", decimals=3, higher_is_better=False
    ),
    SOLVER_ERROR,
    GAIN,
    WHOLE_TOUCH,
    CONTACT,
    Measure(
        "touch.pyrender_psnr_contact_db", "Touch, pyrender against compiled, contact region", occasional=True
    ),
)
# Beside those that a report is about: versions are compared by them, too.
OTHERS = (
    Measure("touch.ssim", "Touch, structural similarity", "", 4, True),
    Measure("audio.stft_distance", "Sound, spectrogram distance", "", 6, False),
    Measure("audio.envelope_distance", "Sound, envelope distance", "", 6, False),
    Measure("audio.damping_error_relative", "Modal damping, largest relative error", "", 6, False),
)
BYTES = Measure("bytes.total", "Object File", "bytes", 0, False, 3e6)
BYTE_PARTS = ("total", "surface", "vision", "audio", "touch", "metadata")
# The headline figure of each sense, wherever an object or a data set is summed up. The three are decibels of
# the same kind, so their margins can be compared.
HEADLINE = (FOREGROUND, GAIN, CONTACT)


def smallest_margin_db(attributes: Mapping[str, Any]) -> float | None:
    """Return the smallest margin of an object to a target over `HEADLINE`, dB; None without a measure."""
    margins = [measure.margin(value) for measure in HEADLINE if (value := measure.of(attributes)) is not None]
    return min(margins, default=None)
