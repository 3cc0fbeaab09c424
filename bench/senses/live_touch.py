"""How often a second two fingers that squeeze a mug are felt, on one core, and how exact shear is.

    OMP_NUM_THREADS=1 python -m bench.senses.live_touch

In MuJoCo two fingers close on the mug of the package, a cylinder of its mass, lift it, shake it and ease off
until it slips. Images, forces and markers of both are asked for after every few steps; what takes the seconds
is told apart. Then a ball on a half-space is sheared, against Cattaneo and Mindlin.
"""

import os
from typing import Any

import numpy as np

import objectfolder
from bench.record import Stopwatch, arguments, conclude, save, subplots
from objectfolder.live import Finger, LiveTouch, MujocoSimulation
from objectfolder.object_file import ObjectFile
from objectfolder.touch.elastic.contact_problem import solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.shear import solve_shear

STEP_S, BETWEEN, RUNS = 0.002, 8, 3
SQUEEZE_N, FRICTION, HEIGHT_M = 6.0, 0.8, 0.05
# Of the scene, seconds: closed, lifted, shaken; then they ease off.
CLOSED_S, LIFTED_S, SHAKEN_S, END_S = 0.5, 1.0, 2.0, 2.4
SHARES, MODULUS_PA, RADIUS_M, PRESSED_N, CELLS, WIDTH_M = (0.3, 0.6, 0.9), 2e5, 0.02, 0.35, 96, 0.008
COMPARED = (
    "pairs of touches over CPU seconds of one core, alone and with markers; stick radius, shift and traction "
    "of a sheared ball against the closed form, the radius over that of the contact"
)


def scene(file: ObjectFile) -> Any:
    """A mug between two fingers that slide towards it and up, as a model of MuJoCo."""
    import mujoco

    (low, _), known = file.surface.bounds, file.description["body"]
    (a, d, e), (_, b, f), (_, _, c) = known["inertia_kg_m2"]
    radius, (apex, _, middle) = -float(low[1]), Finger().sensor.gel_apex_m
    ball = 0.0325  # as round as the gel is at its apex
    fingers = "".join(
        f'<body name="{name}" pos="0 {-side * (radius + apex)} {HEIGHT_M - middle}" euler="0 0 {90 * side}"'
        f' gravcomp="1"><joint name="{name}_close" type="slide" axis="1 0 0" damping="20"/>'
        f'<joint name="{name}_lift" type="slide" axis="0 0 1" damping="20"/>'
        f'<geom type="sphere" size="{ball}" pos="{apex - ball} 0 {middle}" mass=".1" friction="{FRICTION}"'
        f' solref="-9000 -150" priority="1" condim="4"/></body>'
        for name, side in (("left", 1), ("right", -1))
    )
    motors = "".join(
        f'<motor joint="{name}_close"/><position joint="{name}_lift" kp="2000"/>'
        for name in ("left", "right")
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP_S}" cone="elliptic" impratio="10"/><worldbody>'
        f'<geom type="plane" size="1 1 .1"/>{fingers}<body name="mug"><freejoint/>'
        f'<inertial pos="{_told(known["centre_of_mass_m"])}" mass="{known["mass_kg"]}"'
        f' fullinertia="{_told([a, b, c, d, e, f])}"/>'
        f'<geom type="cylinder" size="{radius} .0476" pos="0 0 .0476"/></body></worldbody>'
        f"<actuator>{motors}</actuator></mujoco>"
    )


def _told(numbers: Any) -> str:
    return " ".join(map(str, numbers))


def command(data: Any) -> None:
    """Set the motors by the time."""
    now = data.time
    force = SQUEEZE_N * min(1.0, now / CLOSED_S)
    height = 0.03 * np.clip((now - CLOSED_S) / (LIFTED_S - CLOSED_S), 0, 1)
    if LIFTED_S < now <= SHAKEN_S:
        height += 0.003 * np.sin(2 * np.pi * 3 * (now - LIFTED_S))
    if now > SHAKEN_S:
        force *= 1 - (now - SHAKEN_S) / (END_S - SHAKEN_S)
    data.ctrl[:] = [force, height, force, height]


def squeeze() -> dict[str, Any]:
    """What it costs, and what is felt meanwhile."""
    import mujoco

    file, watch, rows = objectfolder.example("mug"), Stopwatch(), []
    model = scene(file)
    data = mujoco.MjData(model)
    simulation = MujocoSimulation(model, data)
    names = ("left", "right")
    touch = LiveTouch(simulation, {"mug": file}, {name: Finger(friction=FRICTION) for name in names})
    for felt in touch.feel().values():  # the first compiles kernels
        felt.markers()
    while data.time < END_S:
        with watch.step("physics"):
            for _ in range(BETWEEN):
                command(data)
                simulation.step()
        with watch.step("images and forces"):
            pair = touch.feel()
        with watch.step("markers"):
            moved = [felt.markers() for felt in pair.values()]
        rows.append(_row(data.time, pair, moved))
    pairs = len(rows)
    images_s = watch.cpu_s["images and forces"]
    return {
        "pairs": pairs,
        "pairs_per_cpu_s": pairs / images_s,
        "pairs_with_markers_per_cpu_s": pairs / (images_s + watch.cpu_s["markers"]),
        "real_time_factor_at_62_hz": END_S / sum(watch.cpu_s.values()),
        "cpu_s": dict(watch.cpu_s),
        "felt": rows,
    }


def _row(time_s: float, pair: dict[str, Any], moved: list[Any]) -> dict[str, Any]:
    left, right = pair.values()
    return {
        "time_s": time_s,
        "penetration_mm": [1e3 * one.penetration_m for one in (left, right)],
        "normal_n": [one.normal_n for one in (left, right)],
        "tangential_n": [one.tangential_n for one in (left, right)],
        "sliding": [one.sliding for one in (left, right)],
        "largest_shift_of_a_marker_pixels": [
            float(np.hypot(*(one.pixels - one.rest_pixels).T).max()) for one in moved
        ],
    }


def sheared_balls() -> list[dict[str, float]]:
    """Errors against Cattaneo and Mindlin (Johnson 1985, section 7.2) under shares of the friction."""
    pitch = WIDTH_M / CELLS
    x = (np.arange(CELLS) - (CELLS - 1) / 2) * pitch
    r, gel = x[:, None] ** 2 + x**2, Elastomer(MODULUS_PA, 0.5)
    contact = solve_contact(r / (2 * RADIUS_M), pitch, gel, force_n=PRESSED_N)
    radius = (3 * PRESSED_N * RADIUS_M / (4 * gel.contact_modulus_pa)) ** (1 / 3)
    rows, limit_n = [], FRICTION * PRESSED_N
    for share in SHARES:
        shear = solve_shear(contact, gel, FRICTION, (share * limit_n, 0.0))
        stick = radius * (1 - share) ** (1 / 3)
        shift = 3 * limit_n * 1.5 / (16 * MODULUS_PA / 3 * radius) * (1 - (1 - share) ** (2 / 3))
        inner = np.sqrt(np.maximum(1 - r / stick**2, 0)) * stick / radius
        traction = 1.5 * limit_n / (np.pi * radius**2) * (np.sqrt(np.maximum(1 - r / radius**2, 0)) - inner)
        error = shear.traction_pa[0] - traction
        found = float(np.sqrt(shear.sticking.sum() * pitch**2 / np.pi))
        rows.append(
            {
                "share_of_friction": share,
                "stick_radius_error": (found - stick) / radius,
                "shift_error": float(shear.shift_m[0]) / shift - 1,
                "traction_rms_error": float(np.sqrt((error**2).sum() / (traction**2).sum())),
            }
        )
    return rows


def draw(figures: dict[str, Any]) -> None:
    """What both fingers feel."""
    figure, (above, below) = subplots(2, 1, figsize=(6, 6), sharex=True)
    rows = figures["squeeze"]["felt"]
    times = [row["time_s"] for row in rows]
    for side, (name, style) in enumerate((("left", "-"), ("right", "--"))):
        above.plot(times, [row["normal_n"][side] for row in rows], style, label=f"{name}: pressed")
        above.plot(times, [row["tangential_n"][side] for row in rows], style, label=f"{name}: across")
        below.plot(times, [row["largest_shift_of_a_marker_pixels"][side] for row in rows], style, label=name)
    slides = [row["time_s"] for row in rows if any(row["sliding"])]
    above.plot(slides, [0] * len(slides), "k|", label="slides")
    above.set(ylabel="newtons")
    below.set(xlabel="seconds", ylabel="largest shift of a marker, pixels")
    above.legend(fontsize=8)
    below.legend(fontsize=8)
    save(figure, "live_touch")


def main() -> None:
    arguments(__doc__).parse_args()
    runs = [squeeze() for _ in range(RUNS)]
    figures = {
        "squeeze": max(runs, key=lambda run: float(run["pairs_per_cpu_s"])),
        "cattaneo_mindlin": sheared_balls(),
    }
    settings = {"step_s": STEP_S, "steps_between": BETWEEN, "squeeze_n": SQUEEZE_N, "friction": FRICTION}
    settings |= {"runs": RUNS, "threads": os.environ.get("OMP_NUM_THREADS", "all")}
    conclude("live_touch", figures, settings, COMPARED, draw)


if __name__ == "__main__":
    main()
