"""Sound of a bell's modes through the air against bempp-cl, and what the air of objects costs.

    python -m bench air --folder FOLDER

The bell moves as in three pairs of its own modes; its reference is bempp-cl (`pip install bempp-cl`) on the
body's own surface. Cost, bytes and stated errors are of all modes of objects. Rows are kept in FOLDER. Closed
forms of spheres are tests (`tests/audio/test_air_transfer.py`).
"""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.record import REPOSITORY, conclude, cpu_seconds, measure_once, rows_of, spread
from bench.senses.catalogue import MATERIALS, Scans, scan_arguments
from objectfolder.audio.air.multipoles import DENSITY_KG_M3, SOUND_SPEED_M_S
from objectfolder.audio.air.transfer import AirTransfer
from objectfolder.making.air.radiation import Radiation, radiate
from objectfolder.making.air.radiation_product import radiation_of
from objectfolder.making.materials import Material, find_material, read_materials
from objectfolder.making.modes.modes import simulate_modes
from objectfolder.surface.surface import Surface
from pipeline.intake.starter.write import write_starter_set
from tests.references.bodies import BODIES
from tests.references.exterior import radiated
from tests.references.free_modes import FreeModes

Floats = NDArray[np.float64]
COMPARED = (
    "pressure at 20 random directions a metre away through stored multipoles with the reference; level "
    "differences where the reference is within 15 dB of its loudest direction, and in all 20, and the rms "
    "difference over the rms pressure; residuals are the stated errors of the far field"
)
DISTANCE_M = 1.0
# Pairs of the bell's own modes, in ascending order of frequency, and edges of the reference: six a wavelength
# at least.
OWN = (((0, 1), 0.0075), ((2, 3), 0.0065), ((8, 9), 0.0055))
QUIET_DB = 15.0
STARTER = ("fork", "bell", "mug")
SCANS = ("005_tomato_soup_can", "042_adjustable_wrench")


def directions() -> Floats:
    vectors = np.random.default_rng(0).normal(size=(20, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def compared(heard: NDArray[np.complex128], true: NDArray[np.complex128]) -> dict[str, float]:
    """Differences of one motion over directions (n,)."""
    level = 20 * np.log10(np.abs(heard) / np.abs(true))
    loud = np.abs(true) > 10 ** (-QUIET_DB / 20) * np.abs(true).max()
    return {
        "worst_db": float(np.abs(level[loud]).max()),
        "worst_of_all_db": float(np.abs(level).max()),
        "relative": float(np.linalg.norm(heard - true) / np.linalg.norm(true)),
    }


def heard_at(radiation: Radiation, places: Floats) -> NDArray[np.complex128]:
    transfer = AirTransfer.of(radiation)
    return np.stack([transfer.pressures(place) for place in places])


def solved(mesh: Surface, velocity: Floats, hertz: float, centre_m: Floats) -> dict[str, Any]:
    """Pressures of motions with normal velocities (faces, motions) by bempp-cl, and the cost.

    They have a real and an imaginary part (2, places, motions).
    """
    k = 2 * np.pi * hertz / SOUND_SPEED_M_S
    begin = cpu_seconds()
    field = radiated(mesh, velocity, k, centre_m + DISTANCE_M * directions())
    pressure = 1j * k * SOUND_SPEED_M_S * DENSITY_KG_M3 * field
    parts = [pressure.real.tolist(), pressure.imag.tolist()]
    return {"parts": parts, "cpu_s": cpu_seconds() - begin}


def own_reference(modes: FreeModes, pair: tuple[int, ...], edge_m: float, centre_m: Floats) -> dict[str, Any]:
    """Pressures of a pair of the bell's modes, as `solved` has them, at their mean frequency."""
    mesh, hertz = BODIES["bell"]().surface(edge_m), float(modes.frequencies_hz[list(pair)].mean())
    velocity = modes.normal_velocity(mesh, list(pair))
    return {"triangles": len(mesh.faces), **solved(mesh, velocity, hertz, centre_m)}


def own(folder: Path) -> dict[str, Any]:
    """Differences of pairs of the bell's own modes."""
    modes = FreeModes.of(*bell_body())
    surface, rows, reference_s = modes.boundary.surface, {}, 0.0
    for pair, edge_m in OWN:
        shapes = partial(modes.boundary.at, modes.vectors[:, :, list(pair)])
        radiation = radiate(surface, shapes, modes.frequencies_hz[list(pair)])
        heard = heard_at(radiation, radiation.centre_m + DISTANCE_M * directions())
        measure = partial(own_reference, modes, pair, edge_m, radiation.centre_m)
        reference = measure_once(folder / f"bempp_modes_{pair[0]}_{pair[1]}.json", measure)
        true = np.array(reference["parts"][0]) + 1j * np.array(reference["parts"][1])
        reference_s += reference["cpu_s"]
        for column, mode in enumerate(pair):
            row = {
                **compared(heard[:, column], true[:, column]),
                "residual": float(radiation.residuals[column]),
            }
            hertz = float(modes.frequencies_hz[mode])
            rows[f"own mode {mode + 1}, {hertz:.0f} Hz"] = {**row, "triangles": reference["triangles"]}
    return {"motions": rows, "reference_cpu_s": reference_s}


def bell_body() -> tuple[Surface, Material]:
    """Return the surface and the material of the bell."""
    body = BODIES["bell"]()
    return body.surface(), find_material(read_materials(MATERIALS), body.material, "bell")


def starter_set(folder: Path) -> Scans:
    """Write the starter set and return it."""
    write_starter_set(folder / "starter")
    return Scans(Path(shutil.copy(REPOSITORY / "data" / "starter.csv", folder)))


def costs(folder: Path, scans: Scans) -> dict[str, Any]:
    """Cost of the bell, of starter objects and of scans, by name."""
    starter = starter_set(folder)
    objects = {"bell": bell_body}
    objects |= {name: partial(scans.body, name) for name in SCANS}
    objects |= {f"{name} (starter)": partial(starter.body, name) for name in STARTER}
    return rows_of(objects, lambda name: cost(name, objects[name]), folder / "costs")


def cost(name: str, make: Callable[[], tuple[Surface, Material]]) -> dict[str, Any]:
    """CPU seconds, bytes and stated errors of the air of all modes of an object."""
    surface, material = make()
    seconds: dict[str, float] = {}
    settings = {"max_modes": 128, "training_points": 100, "held_out_points": 10, "seed": 0}
    modes = simulate_modes(surface, material, name=name, transfer="multipole", seconds=seconds, **settings)
    radiation = radiation_of(modes)
    assert radiation is not None
    stored = AirTransfer.of(radiation).tensors().values()
    return {
        "modes": len(radiation.residuals),
        "air_cpu_s": seconds["air"],
        "bytes": sum(tensor.nbytes for tensor in stored),
        "residuals": radiation.residuals.tolist(),
    }


def main() -> None:
    options = scan_arguments(__doc__, "rows").parse_args()
    folder, scans = options.folder, Scans(options.objects)
    figures = {"bell_modes": measure_once(folder / "bell_modes.json", lambda: own(folder))}
    figures["objects"] = costs(folder, scans)
    figures["objects_air_cpu_s"] = spread(figures["objects"].values(), "air_cpu_s", max)
    print(figures["bell_modes"], figures["objects_air_cpu_s"])
    settings = {"distance_m": DISTANCE_M, "reference_edges_of_pairs_m": [edge_m for _, edge_m in OWN]}
    conclude("air", figures, settings, COMPARED)
