"""Sound through the air against closed forms of a sphere and bempp-cl's of a bell.

    python -m bench air --folder FOLDER

Pulsating, oscillating and with a piston of 30 degrees, a sphere has its field in closed form. The bell's
surface moves with 0 to 4 waves round it, smoothly along its wall, at frequencies at which such modes ring,
and as it does in three pairs of its own modes; its reference is bempp-cl (`pip install bempp-cl`) on the
body's own surface. Cost, bytes and stated errors are of all modes of objects. Rows are kept in FOLDER.
"""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.special import eval_legendre, spherical_jn, spherical_yn

from bench.record import REPOSITORY, conclude, cpu_seconds, kept
from bench.senses.catalogue import MATERIALS, Scans, scan_arguments
from objectfolder.audio.air.multipoles import DENSITY_KG_M3, SOUND_SPEED_M_S
from objectfolder.audio.air.radiation import Radiation, radiate
from objectfolder.audio.air.radiation_product import radiation_of
from objectfolder.audio.air.transfer import AirTransfer
from objectfolder.audio.materials import Material, find_material, read_materials
from objectfolder.audio.modes.modes import simulate_modes
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
RADIUS_M, DISTANCE_M = 0.1, 1.0
WAVENUMBER_RADII = (1.0, 3.0, 5.0, 10.0)
PISTON, ORDERS = float(np.cos(np.pi / 6)), 80
SPHERES = ("pulsating", "oscillating", "piston")
# Waves round the bell, ripples along it, hertz.
BELL = ((2, 0, 1500.0), (0, 1, 5000.0), (3, 1, 5000.0), (4, 0, 10000.0), (2, 6, 10000.0))
BELL_EDGE_M, REFERENCE_EDGE_M = 0.002, 0.0055
# Pairs of the bell's own modes, in ascending order of frequency, and edges of the reference: six a wavelength
# at least.
OWN = (((0, 1), 0.0075), ((2, 3), 0.0065), ((8, 9), 0.0055))
QUIET_DB = 15.0
STARTER = ("fork", "bell", "mug")
SCANS = ("005_tomato_soup_can", "042_adjustable_wrench")


def directions() -> Floats:
    drawn = np.random.default_rng(0).normal(size=(20, 3))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def compared(heard: NDArray[np.complex128], true: NDArray[np.complex128]) -> dict[str, float]:
    """Differences of one motion over directions (n,)."""
    level = 20 * np.log10(np.abs(heard) / np.abs(true))
    loud = np.abs(true) > 10 ** (-QUIET_DB / 20) * np.abs(true).max()
    return {
        "worst_db": float(np.abs(level[loud]).max()),
        "worst_of_all_db": float(np.abs(level).max()),
        "relative": float(np.linalg.norm(heard - true) / np.linalg.norm(true)),
    }


def heard_at(found: Radiation, places: Floats) -> NDArray[np.complex128]:
    transfer = AirTransfer.of(found)
    return np.stack([transfer.pressures(place) for place in places])


def sphere(wavenumber_radius: float) -> dict[str, Any]:
    ball = trimesh.creation.icosphere(5, RADIUS_M)
    surface = Surface(np.array(ball.vertices), np.array(ball.faces))

    def shapes(face: NDArray[np.int64], barycentric: Floats) -> Floats:
        outward = surface.points_at(face, barycentric)
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        z = outward[:, 2]
        return outward[:, :, None] * np.stack([np.ones(len(z)), z, z > PISTON], axis=1)[:, None]

    k = wavenumber_radius / RADIUS_M
    begin = cpu_seconds()
    found = radiate(surface, shapes, np.full(3, k * SOUND_SPEED_M_S / (2 * np.pi)))
    spent = cpu_seconds() - begin
    places = DISTANCE_M * directions()
    heard = heard_at(found, places)
    order = np.arange(ORDERS + 1)
    cap = np.concatenate(
        [[(1 - PISTON) / 2], (eval_legendre(order[:-2], PISTON) - eval_legendre(order[2:], PISTON)) / 2]
    )
    rows = {}
    for mode, name in enumerate(SPHERES):
        coefficients = cap if name == "piston" else np.eye(len(cap))[mode]
        true = spherical(coefficients, k, places)
        rows[name] = {**compared(heard[:, mode], true), "residual": float(found.residuals[mode])}
    return {"motions": rows, "cpu_s": spent}


def spherical(coefficients: Floats, k: float, places: Floats) -> NDArray[np.complex128]:
    """Pressure of a sphere whose normal velocity has these Legendre coefficients."""
    order = np.arange(len(coefficients))[:, None]
    x = k * np.linalg.norm(places, axis=1)
    outgoing = spherical_jn(order, x) + 1j * spherical_yn(order, x)
    slope = spherical_jn(order, k * RADIUS_M, True) + 1j * spherical_yn(order, k * RADIUS_M, True)
    angular = eval_legendre(order, places[:, 2] / np.linalg.norm(places, axis=1))
    return (
        1j
        * DENSITY_KG_M3
        * SOUND_SPEED_M_S
        * (coefficients[:, None] * angular * outgoing / slope).sum(axis=0)
    )


def bell_motion(points: Floats) -> Floats:
    """Displacements (n, 3, motions) of places on the bell."""
    scaled = points / 0.05
    around = scaled[:, 0] + 1j * scaled[:, 1]
    moved = []
    for waves, ripples, _ in BELL:
        size = (around**waves).real * np.cos(ripples * scaled[:, 2])
        moved.append(np.stack([size * scaled[:, 0], size * scaled[:, 1], 0.5 * size], axis=1))
    return np.stack(moved, axis=2)


def reference(hertz: float, centre_m: Floats) -> dict[str, Any]:
    """Pressures of the motions of a frequency, real and imaginary part (2, places, motions), by bempp-cl."""
    mesh = BODIES["bell"]().surface(REFERENCE_EDGE_M)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    which = [number for number, motion in enumerate(BELL) if motion[2] == hertz]
    velocity = np.einsum("tk,tkm->tm", mesh.face_normals, bell_motion(middle))[:, which]
    return {"motions": which, **solved(mesh, velocity, hertz, centre_m)}


def solved(mesh: Surface, velocity: Floats, hertz: float, centre_m: Floats) -> dict[str, Any]:
    """Pressures of motions with normal velocities (faces, motions), as `reference` has them, and the cost."""
    k = 2 * np.pi * hertz / SOUND_SPEED_M_S
    begin = cpu_seconds()
    field = radiated(mesh, velocity, k, centre_m + DISTANCE_M * directions())
    pressure = 1j * k * SOUND_SPEED_M_S * DENSITY_KG_M3 * field
    parts = [pressure.real.tolist(), pressure.imag.tolist()]
    return {"parts": parts, "cpu_s": cpu_seconds() - begin}


def bell(folder: Path) -> dict[str, Any]:
    surface = BODIES["bell"]().surface(BELL_EDGE_M)
    frequencies = np.array([hertz for *_, hertz in BELL])
    begin = cpu_seconds()
    found = radiate(surface, lambda *place: bell_motion(surface.points_at(*place)), frequencies)
    spent = cpu_seconds() - begin
    heard = heard_at(found, found.centre_m + DISTANCE_M * directions())
    rows, reference_s = {}, 0.0
    for hertz in np.unique(frequencies):
        kept_row = kept(folder / f"bempp_{hertz:g}.json", lambda at=hertz: reference(at, found.centre_m))
        true = np.array(kept_row["parts"][0]) + 1j * np.array(kept_row["parts"][1])
        reference_s += kept_row["cpu_s"]
        for column, mode in enumerate(kept_row["motions"]):
            waves, ripples, _ = BELL[mode]
            differences = compared(heard[:, mode], true[:, column])
            name = f"{waves} waves, {ripples} ripples, {hertz:g} Hz"
            rows[name] = {**differences, "residual": float(found.residuals[mode])}
    return {"motions": rows, "cpu_s": spent, "reference_cpu_s": reference_s}


def own_reference(modes: FreeModes, pair: tuple[int, ...], edge_m: float, centre_m: Floats) -> dict[str, Any]:
    """Pressures of a pair of the bell's modes, as `reference` has them, at their mean frequency."""
    mesh, hertz = BODIES["bell"]().surface(edge_m), float(modes.frequencies_hz[list(pair)].mean())
    velocity = modes.normal_velocity(mesh, list(pair))
    return {"triangles": len(mesh.faces), **solved(mesh, velocity, hertz, centre_m)}


def own(folder: Path) -> dict[str, Any]:
    """Differences of pairs of the bell's own modes."""
    modes = FreeModes.of(*bell_body())
    surface, rows, reference_s = modes.boundary.surface, {}, 0.0
    for pair, edge_m in OWN:
        shapes = partial(modes.boundary.at, modes.vectors[:, :, list(pair)])
        found = radiate(surface, shapes, modes.frequencies_hz[list(pair)])
        heard = heard_at(found, found.centre_m + DISTANCE_M * directions())
        measure = partial(own_reference, modes, pair, edge_m, found.centre_m)
        kept_row = kept(folder / f"bempp_modes_{pair[0]}_{pair[1]}.json", measure)
        true = np.array(kept_row["parts"][0]) + 1j * np.array(kept_row["parts"][1])
        reference_s += kept_row["cpu_s"]
        for column, mode in enumerate(pair):
            row = {**compared(heard[:, column], true[:, column]), "residual": float(found.residuals[column])}
            hertz = float(modes.frequencies_hz[mode])
            rows[f"own mode {mode + 1}, {hertz:.0f} Hz"] = {**row, "triangles": kept_row["triangles"]}
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
    return {
        name: kept(folder / f"cost_{name}.json", partial(cost, name, make)) for name, make in objects.items()
    }


def cost(name: str, make: Callable[[], tuple[Surface, Material]]) -> dict[str, Any]:
    """CPU seconds, bytes and stated errors of the air of all modes of an object."""
    surface, material = make()
    seconds: dict[str, float] = {}
    wanted = {"max_modes": 128, "training_points": 100, "held_out_points": 10, "seed": 0}
    modes = simulate_modes(surface, material, name=name, transfer="multipole", seconds=seconds, **wanted)
    found = radiation_of(modes)
    assert found is not None
    stored = AirTransfer.of(found).tensors().values()
    return {
        "modes": len(found.residuals),
        "air_cpu_s": seconds["air"],
        "bytes": sum(tensor.nbytes for tensor in stored),
        "residuals": found.residuals.tolist(),
    }


def main() -> None:
    options = scan_arguments(__doc__, "rows").parse_args()
    folder, scans = options.folder, Scans(options.objects)
    spheres = {}
    for x in WAVENUMBER_RADII:
        spheres[f"{x:g}"] = kept(folder / f"sphere_{x:g}.json", lambda at=x: sphere(at))
        print(x, spheres[f"{x:g}"], flush=True)
    figures = {"spheres": spheres, "bell": kept(folder / "bell.json", lambda: bell(folder))}
    figures["bell_modes"] = kept(folder / "bell_modes.json", lambda: own(folder))
    figures["objects"] = costs(folder, scans)
    figures["objects_median_cpu_s"] = float(
        np.median([row["air_cpu_s"] for row in figures["objects"].values()])
    )
    print(figures["bell"], figures["bell_modes"], figures["objects_median_cpu_s"])
    settings = {"sphere_radius_m": RADIUS_M, "distance_m": DISTANCE_M, "reference_edge_m": REFERENCE_EDGE_M}
    settings["reference_edges_of_pairs_m"] = [edge_m for _, edge_m in OWN]
    conclude("air", figures, settings, COMPARED)
