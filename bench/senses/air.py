"""Sound through the air against closed forms of a sphere and bempp-cl's of a bell.

    python -m bench.senses.air --folder FOLDER

Pulsating, oscillating and with a piston of 30 degrees, a sphere has its field in closed form. The bell's
surface moves with 0 to 4 waves round it, smoothly along its wall, at frequencies at which such modes ring;
its reference is bempp-cl (`pip install bempp-cl`) on the body's own surface. Cost, bytes and residuals are of
the modes of a bell and of three scans. Rows are kept in FOLDER.
"""

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.special import eval_legendre, spherical_jn, spherical_yn

from bench.record import conclude, cpu_seconds, kept, save, subplots
from bench.references.bodies import BODIES
from bench.references.exterior import radiated
from bench.senses.catalogue import MATERIALS, Scans, scan_arguments
from objectfolder.audio.air.multipoles import DENSITY_KG_M3, SOUND_SPEED_M_S, radiation_of
from objectfolder.audio.air.radiation import Radiation, radiate
from objectfolder.audio.air.transfer import AirTransfer
from objectfolder.audio.materials import find_material, read_materials
from objectfolder.audio.modes.modes import simulate_modes
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
COMPARED = (
    "pressure at 20 random directions a metre away through stored multipoles with the reference; level "
    "differences where the reference is within 15 dB of its loudest direction, and the rms difference over "
    "the rms pressure; residuals are those stated"
)
RADIUS_M, DISTANCE_M = 0.1, 1.0
WAVENUMBER_RADII = (1.0, 3.0, 5.0, 10.0)
PISTON, ORDERS = float(np.cos(np.pi / 6)), 80
SPHERES = ("pulsating", "oscillating", "piston")
# Waves round the bell, ripples along it, hertz.
BELL = ((2, 0, 1500.0), (0, 1, 5000.0), (3, 1, 5000.0), (4, 0, 10000.0), (2, 6, 10000.0))
BELL_EDGE_M, REFERENCE_EDGE_M = 0.002, 0.0055
QUIET_DB = 15.0
SCANS = ("005_tomato_soup_can", "042_adjustable_wrench", "024_bowl")


def directions() -> Floats:
    drawn = np.random.default_rng(0).normal(size=(20, 3))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def compared(heard: NDArray[np.complex128], true: NDArray[np.complex128]) -> dict[str, float]:
    """Differences of one motion over directions (n,)."""
    level = 20 * np.log10(np.abs(heard) / np.abs(true))
    loud = np.abs(true) > 10 ** (-QUIET_DB / 20) * np.abs(true).max()
    return {
        "worst_db": float(np.abs(level[loud]).max()),
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
    k = 2 * np.pi * hertz / SOUND_SPEED_M_S
    begin = cpu_seconds()
    field = radiated(mesh, velocity, k, centre_m + DISTANCE_M * directions())
    pressure = 1j * k * SOUND_SPEED_M_S * DENSITY_KG_M3 * field
    parts = [pressure.real.tolist(), pressure.imag.tolist()]
    return {"motions": which, "parts": parts, "cpu_s": cpu_seconds() - begin}


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


def cost(name: str, scans: Scans) -> dict[str, Any]:
    """CPU seconds, bytes and residuals of the air of all modes of an object."""
    if name in BODIES:
        body = BODIES[name]()
        surface, material = body.surface(), find_material(read_materials(MATERIALS), body.material, name)
    else:
        surface, material = scans.surface(name), scans.material(name)
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


def draw(figures: dict[str, Any]) -> None:
    """Worst level difference of each motion."""
    figure, (left, right, last) = subplots(1, 3, figsize=(15, 4))
    spheres = figures["spheres"]
    for name in SPHERES:
        worst = [row["motions"][name]["worst_db"] for row in spheres.values()]
        left.plot([float(x) for x in spheres], worst, "o-", label=name)
    left.set(xscale="log", xlabel="k a of the sphere", ylabel="worst of 20 directions, dB")
    left.legend()
    rows = figures["bell"]["motions"]
    right.barh(list(rows), [row["worst_db"] for row in rows.values()])
    right.set(xlabel="bell against bempp-cl, worst of the louder directions, dB")
    for name, row in figures["objects"].items():
        share = np.arange(1, row["modes"] + 1) / row["modes"]
        last.step(np.sort(row["residuals"]), share, where="post", label=name)
    last.set(
        xscale="log", xlabel="residual of a mode", ylabel="share of modes with at most that", ylim=(0, 1)
    )
    last.legend()
    save(figure, "air")


def main() -> None:
    options = scan_arguments(__doc__, "rows").parse_args()
    folder, scans = options.folder, Scans(options.objects)
    spheres = {}
    for x in WAVENUMBER_RADII:
        spheres[f"{x:g}"] = kept(folder / f"sphere_{x:g}.json", lambda at=x: sphere(at))
        print(x, spheres[f"{x:g}"], flush=True)
    figures = {"spheres": spheres, "bell": kept(folder / "bell.json", lambda: bell(folder))}
    figures["objects"] = {
        name: kept(folder / f"cost_{name}.json", lambda of=name: cost(of, scans)) for name in ("bell", *SCANS)
    }
    print(figures["bell"])
    settings = {"sphere_radius_m": RADIUS_M, "distance_m": DISTANCE_M, "reference_edge_m": REFERENCE_EDGE_M}
    conclude("air", figures, settings, COMPARED, draw)


if __name__ == "__main__":
    main()
