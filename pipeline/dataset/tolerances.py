"""How far apart products of the same inputs are on different machines, by stage and array.

Measured on processors of two vendors and by ``bench/factory/machines.py`` (see ``docs/reproducibility.md``),
and declared with a margin. Names are patterns, the first that fits counts; what none fits is the same bytes.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any

from pydantic import Field

Share = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class Tolerance:
    """How far values may be apart.

    Parameters
    ----------
    relative
        Largest difference, as a share of the array's range.
    rms
        Root mean square of the differences, likewise.
    absolute
        Added to both, in the array's unit: for values that are rounding errors themselves.
    because
        What makes them differ, and what it means.
    """

    relative: Share = 0.0
    rms: Share = 0.0
    absolute: Share = 0.0
    because: str = ""


def as_json(tolerances: Mapping[str, Tolerance]) -> dict[str, Any]:
    """Return tolerances by array as a product's provenance holds them."""
    return {name: asdict(tolerance) for name, tolerance in tolerances.items()}


SAME_BYTES = Tolerance()

_SOLVED = (
    "MKL adds in another order on AMD than on Intel, and without AVX2 the tetrahedra differ, too; "
    "1e-4 of 20 kHz is 0.2 cents there"
)
_RADIATED = (
    "rounding changes the coarse elements that the air is solved on: half a per cent of a rate on a bar, "
    "which is .02 dB; dampings_per_s has these rates in it"
)
_CYCLES = "Cycles rounds differently on AMD and on Intel; rms 1e-5 of the range is -100 dB"
_FITTED = (
    "MKL's sums and exponential on AMD and on Intel, amplified by the steps of the optimiser: another fit "
    "as good; what it means is in fidelity"
)
_SUMMED = "sums in another order"

TOLERANCES: Mapping[str, Mapping[str, Tolerance]] = {
    "objects": {},
    "views": {
        "rgba": Tolerance(relative=1e-2, rms=1e-5, because=_CYCLES),
        "condition_rgba": Tolerance(relative=1e-2, rms=1e-5, because=_CYCLES),
        "attributes/conditions/*/noise_floor_db": Tolerance(absolute=0.01, because=_CYCLES),
        "attributes/noise_floor*_db": Tolerance(absolute=0.01, because=_CYCLES),
    },
    "modes": {
        "eigenvalues": Tolerance(2e-4, 5e-5, because=_SOLVED),
        "frequencies_hz": Tolerance(1e-4, 3e-5, because=_SOLVED),
        "dampings_per_s": Tolerance(2e-2, 2e-2, because=_RADIATED),
        "error_estimates_cents": Tolerance(absolute=0.2, because=_SOLVED),
        "mode_shapes": Tolerance(2e-2, 2e-3, because=_SOLVED),
        "radiation_dampings_per_s": Tolerance(2e-2, 2e-2, because=_RADIATED),
        "radiation_weights": Tolerance(1e-3, 2e-4, because=_SOLVED),
        "residuals": Tolerance(3e-2, 1e-2, because=_SOLVED),
        "multipoles": Tolerance(2e-2, 2e-3, because=_SOLVED),
        "transfer_wavenumbers": Tolerance(1e-4, 3e-5, because=_SOLVED),
        "transfer_residuals": Tolerance(5e-2, 2e-2, because=_SOLVED),
        "attributes/rigid_frequency_hz": Tolerance(
            absolute=0.1, because="a rounding error itself: zero but for it"
        ),
        "attributes/*": Tolerance(3e-2, 3e-2, 1e-9, because=_SOLVED),
    },
    "touches": {
        name: Tolerance(1e-12, 1e-12, because=_SUMMED)
        for name in (
            "contact_area_m2",
            "first_contact_offset_m",
            "normals",
            "penetration_m",
            "sensor_to_object",
        )
    },
    "collision": {},
    "encode": {
        "vision.*": Tolerance(1.0, 0.1, because=_FITTED),
        "audio.step": Tolerance(1e-6, 1e-6, because=_SUMMED),
        "attributes/audio/*": Tolerance(1e-6, 1e-6, because=_SUMMED),
    },
    "fidelity": {
        "strike_truth": Tolerance(absolute=1.0, because="one step of 16 bits, from rounding"),
        "strike_difference": Tolerance(absolute=1.0, because="one step of 8 bits, from rounding"),
        "strike_*": Tolerance(1e-5, 1e-5, because=_SUMMED),
        "vision_answer": Tolerance(absolute=1.0, because="one grey level of 255, from rounding"),
        "attributes/bytes/*": Tolerance(1e-3, 1e-3, because="digits of numbers that are rounded otherwise"),
        "attributes/*": Tolerance(1e-4, 1e-4, 1e-9, because=_SUMMED),
    },
}
