"""What modes lose to the air by coarse boundary elements, against the finest of `transfer: multipole`.

    python -m bench radiation --folder FOLDER [--only NAME ...]

Modes below 10 kHz of thin open objects of the starter set. Rows are kept in FOLDER and not measured again.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.record import arguments, conclude, cpu_seconds, measure_once
from bench.senses.air import starter_set
from objectfolder.audio.air.multipoles import DENSITY_KG_M3, SOUND_SPEED_M_S
from objectfolder.audio.synthesis.air import quadrupole_efficiency
from objectfolder.making.air.radiation import radiate
from objectfolder.making.air.radiation_loss import dampings_of, radiation_dampings
from objectfolder.making.damping import damping_of
from objectfolder.surface.surface import Surface
from tests.references.free_modes import FreeModes

Floats = NDArray[np.float64]
COMPARED = (
    "decay rates by radiation of modes below 10 kHz, level differences in dB with elements of 2,500 vertices "
    "at each mode's own wavenumber, whose stated errors are of the far field; sphere: the model of a "
    "sphere of the same area; share: of each mode's energy that is radiated, all modes below 20 kHz"
)
OBJECTS = ("mug", "bell", "bowl", "plate")
HIGHEST_HZ = 10_000.0


def measure(folder: Path, name: str) -> dict[str, Any]:
    """Rates of an object's modes by both, and by the sphere's model."""
    surface, material = starter_set(folder).body(name)
    modes = FreeModes.of(surface, material)
    outside, hertz = modes.boundary.surface, modes.frequencies_hz
    scaled = modes.vectors / np.sqrt(material.density_kg_m3 * modes.length_m**3)
    low = np.flatnonzero(hertz < HIGHEST_HZ)
    begin = cpu_seconds()
    own = radiation_dampings(outside, partial(modes.boundary.at, scaled), hertz)
    spent = cpu_seconds() - begin
    begin = cpu_seconds()
    fine = radiate(outside, partial(modes.boundary.at, scaled[:, :, low]), hertz[low])
    reference_s = cpu_seconds() - begin
    return {
        "hz": hertz.tolist(),
        "own": own.tolist(),
        "ref": dampings_of(fine).tolist(),
        "res": fine.residuals.tolist(),
        "old": of_sphere(outside, hertz, modes.boundary.normal_rms(scaled)).tolist(),
        "damp": damping_of(material).decay_rates((2 * np.pi * hertz) ** 2).tolist(),
        "t_own": spent,
        "t_ref": reference_s,
    }


def of_sphere(surface: Surface, hertz: Floats, normal_rms: Floats) -> Floats:
    """Rates (modes,) of a sphere of the same area that moves in its quadrupole."""
    radius = np.sqrt(surface.area / (4 * np.pi))
    efficiency = quadrupole_efficiency(2 * np.pi * hertz * radius / SOUND_SPEED_M_S)
    return DENSITY_KG_M3 * SOUND_SPEED_M_S * surface.area * efficiency * normal_rms**2 / 2


def differences(row: dict[str, Any]) -> dict[str, Any]:
    """Level differences of an object's modes."""
    true = np.array(row["ref"])
    own, sphere = (10 * np.log10(np.array(row[name])[: len(true)] / true) for name in ("own", "old"))
    share = np.array(row["own"]) / (np.array(row["own"]) + np.array(row["damp"]))
    return {
        "modes": len(true),
        "median_db": float(np.median(np.abs(own))),
        "worst_db": float(np.abs(own).max()),
        "sphere_median_db": float(np.median(np.abs(sphere))),
        "sphere_worst_db": float(np.abs(sphere).max()),
        "median_stated_error": float(np.median(row["res"])),
        "largest_share": float(share.max()),
        "all_modes": len(row["hz"]),
        "cpu_s": row["t_own"],
        "reference_cpu_s": row["t_ref"],
        "levels_db": np.round(own, 2).tolist(),
        "sphere_levels_db": np.round(sphere, 2).tolist(),
        "hertz": np.round(row["hz"][: len(true)], 1).tolist(),
    }


def main() -> None:
    options = arguments(__doc__, keeps="rows", only=OBJECTS).parse_args()
    rows = {}
    for name in options.only:
        row = measure_once(options.folder / f"loss_{name}.json", partial(measure, options.folder, name))
        rows[name] = differences(row)
        print(
            name, {key: value for key, value in rows[name].items() if not isinstance(value, list)}, flush=True
        )
    conclude("radiation", {"objects": rows}, {"highest_hz": HIGHEST_HZ}, COMPARED)
