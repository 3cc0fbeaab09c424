"""How much faster than real time objects are heard in a running simulation, on one core.

    OMP_NUM_THREADS=1 python -m bench live

A mug and a bell of the package fall onto a plane, roll and come to rest in MuJoCo, as cylinders of their
masses; a mug rolls without end. Hulls fall in four ways, and what sounds after their last collision is timed.
Then many bodies ring at once, each struck once a second: mugs, and bodies of 100 modes with the mug's shapes
over and over. What takes the seconds is told apart.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

import objectfolder
from bench.record import Stopwatch, arguments, conclude
from bench.senses.simulated import BLOCK, RATE_HZ, STEP_S, Watched, add_body, table
from objectfolder.audio.audionet.audionet import RADIATION, AudioNet
from objectfolder.live import LiveSound, MujocoSimulation
from objectfolder.live.gripper import standing
from objectfolder.live.heard_body import HeardBody
from objectfolder.object_file import ObjectFile
from objectfolder.products.matrix_coding import pack_matrix

SECONDS = 4.0
BODIES, MODES, RUNS = (5, 10, 20, 40), 100, 3
ROLLING_M_S = 0.4
WAYS = ((1.0, 0.0, 0.0, 0.0), (0.98, 0.17, 0.1, 0.0), (0.7, 0.7, 0.1, 0.0), (0.5, -0.3, 0.8, 0.1))
LISTENER_M = (0.0, -0.5, 0.5)
COMPARED = (
    "seconds of sound over CPU seconds of one core; physics, finding contacts and sound together or alone"
)
REFERENCE_PA = 2e-5


def cylinders(names: tuple[str, ...]) -> tuple[Any, dict[str, ObjectFile]]:
    """Objects above a plane, each a cylinder of its mass, as a specification for MuJoCo."""
    import mujoco

    spec, files = table(), {}
    for place, name in enumerate(names):
        file = files[name] = objectfolder.example(name)
        low, high = file.surface.bounds
        x, y, z = (high - low) / 2
        body = add_body(spec, name, file, pos=[0.3 * place, 0, 0.1 - low[2]], quat=[0.98, 0.17, 0.1, 0])
        shape = mujoco.mjtGeom.mjGEOM_CYLINDER
        body.add_geom(type=shape, size=[min(x, y), z, 0], pos=(low + high) / 2)
    return spec, files


def falling(names: tuple[str, ...]) -> dict[str, Any]:
    """A few seconds of objects that fall by 10 cm."""
    import mujoco

    spec, files = cylinders(names)
    model = spec.compile()
    return {"objects": names} | quickest(lambda: simulated(model, lambda: mujoco.MjData(model), files))


def rolling() -> dict[str, Any]:
    """A mug that lies and rolls along, its mass in its middle."""
    import mujoco

    spec, files = cylinders(("mug",))
    (body,) = spec.worldbody.bodies
    radius = body.geoms[0].size[0]
    body.pos, body.quat, body.ipos = [0, 0, radius], [0.5**0.5, 0.5**0.5, 0, 0], body.geoms[0].pos
    model = spec.compile()

    def beginning() -> Any:
        data = mujoco.MjData(model)
        data.qvel[0], data.qvel[5] = ROLLING_M_S, -ROLLING_M_S / radius
        return data

    return {"speed_m_s": ROLLING_M_S} | quickest(lambda: simulated(model, beginning, files))


def simulated(model: Any, beginning: Callable[[], Any], files: dict[str, ObjectFile]) -> dict[str, Any]:
    """What a few seconds cost."""
    watch, simulation = Stopwatch(), Watched(model, beginning())
    simulation.watch = watch
    live = LiveSound(simulation, files, listener_m=LISTENER_M)
    live.block()
    watch.cpu_s.clear()
    with watch.step("all"):
        sound = np.concatenate([live.block() for _ in range(round(SECONDS * RATE_HZ / BLOCK))])
    length_s = len(sound) / RATE_HZ
    return {
        "collisions": len(live.impacts),
        "last_second_pa": float(np.std(sound[-round(RATE_HZ) :])),
        "real_time_factor": length_s / watch.cpu_s["all"],
        "cpu_s_per_second": {name: spent / length_s for name, spent in watch.cpu_s.items()},
    }


def quiet_threshold_db(frequencies_hz: np.ndarray) -> np.ndarray:
    """Return sound pressure levels (n,) of tones just heard in quiet; inf outside of 20 Hz to 20 kHz.

    3.64 f^-.8 - 6.5 exp(-.6 (f - 3.3)^2) + 1e-3 f^4, f in kHz (E. Terhardt, Hear. Res. 1, 1979).
    """
    f = np.clip(frequencies_hz, 20.0, 20e3) / 1e3
    level = 3.64 * f**-0.8 - 6.5 * np.exp(-0.6 * (f - 3.3) ** 2) + 1e-3 * f**4
    return np.where((frequencies_hz >= 20.0) & (frequencies_hz <= 20e3), level, np.inf)


def coming_to_rest(name: str, way: tuple[float, ...]) -> dict[str, Any]:
    """What sounds of an object's hull after its last collision, dropped by 10 cm as a quaternion turns it.

    The last time that a mode above the threshold in quiet grew, and the last that one was above it; how far
    above it was the loudest at that collision; and how long the slowest mode takes to fall by 60 dB.
    """
    import mujoco

    file = objectfolder.example(name)
    model = standing(file, STEP_S)
    data = mujoco.MjData(model)
    data.qpos[2], data.qpos[3:7] = data.qpos[2] + 0.1, way
    live = LiveSound(MujocoSimulation(model, data), {"object": file}, listener_m=LISTENER_M)
    stream = live._bodies["object"].stream
    quiet_pa = np.sqrt(2) * REFERENCE_PA * 10 ** (quiet_threshold_db(stream.loudness()[0]) / 20)
    louder = []
    for _ in range(round(SECONDS * RATE_HZ / BLOCK)):
        live.block()
        louder.append(stream.loudness()[1] / quiet_pa)
    times_s, over = (1 + np.arange(len(louder))) * BLOCK / RATE_HZ, np.array(louder)
    grew = (over[1:] > np.maximum(1.0, (1 + 1e-6) * over[:-1])).any(axis=1)
    last_s = live.impacts[-1].time_s
    return {
        "object": name,
        "way": way,
        "excited_s": float(times_s[1:][grew][-1] - last_s),
        "heard_s": float(times_s[(over > 1).any(axis=1)][-1] - last_s),
        "over_threshold_db": float(20 * np.log10(over[times_s > last_s][0].max())),
        "slowest_60_db_s": float(np.log(1e3) / file.modes.dampings_per_s.min()),
    }


def quickest(run: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Figures of the quickest of some runs: others were disturbed, and the first compiles kernels."""
    return max((run() for _ in range(RUNS)), key=lambda figures: float(figures["real_time_factor"]))


def with_modes(modes: int) -> ObjectFile:
    """The mug with more modes: its shapes over and over, at frequencies evenly apart by ratio."""
    file = objectfolder.example("mug")
    net = file.modes
    which = np.arange(modes) % len(net.eigenvalues)
    angular = 2 * np.pi * np.geomspace(300.0, 18e3, modes)
    material = file.description["material"]
    shapes = net._quantised.reshape(len(net._quantised), 3, -1)[:, :, which]
    # Its decays are others: what radiation has of the mug's is no part of them.
    tensors = {name: tensor for name, tensor in net.tensors().items() if name != f"audio.{RADIATION}"} | {
        "audio.eigenvalues": angular**2,
        "audio.dampings_per_s": (material["rayleigh_alpha_per_s"] + material["rayleigh_beta_s"] * angular**2)
        / 2,
        "audio.radiation_weights": net.radiation_weights[which],
        "audio.coefficients": pack_matrix(shapes.reshape(len(shapes), -1)),
    }
    net = AudioNet.from_tensors(tensors, net.metadata() | {"modes": modes}, file.surface)
    rest = {name: tensor for name, tensor in file.content().tensors.items() if not name.startswith("audio.")}
    tensors = rest | tensors
    return ObjectFile(file.surface, file.frame, file.vision, net, file.touch.net, file.description, tensors)


def ringing(file: ObjectFile, count: int) -> dict[str, Any]:
    """Bodies that ring at once."""
    watch, blocks = Stopwatch(), round(RATE_HZ / BLOCK)
    points, normals = file.sample_contacts(count, seed=0, reachable=False)
    mass_kg, listener_m = file.description["body"]["mass_kg"], np.array(LISTENER_M)
    bodies = [HeardBody.of("mug", file, mass_kg, RATE_HZ, listener_m) for _ in range(count)]
    for second in range(1 + round(SECONDS)):
        if second == 1:  # the first compiles kernels
            watch.cpu_s.clear()
        with watch.step("all"):
            with watch.step("strikes"):
                for body, point, normal in zip(bodies, points, normals, strict=True):
                    body.stream.strike(body.nearest(point), -0.1 * normal, pulse=1e-3)
            for _ in range(blocks):
                for body in bodies:
                    body.stream.block(BLOCK)
    length_s = round(SECONDS) * blocks * BLOCK / RATE_HZ
    spent = watch.cpu_s
    return {
        "bodies": count,
        "modes_of_a_body": len(file.modes.frequencies_hz),
        "real_time_factor": length_s / spent["all"],
        "real_time_factor_between_strikes": length_s / (spent["all"] - spent["strikes"]),
        "cpu_s_per_second": {name: cpu_s / length_s for name, cpu_s in spent.items()},
    }


def main() -> None:
    arguments(__doc__).parse_args()
    mug = objectfolder.example("mug")
    figures = {
        "falling": [falling(names) for names in (("mug",), ("mug", "bell"))],
        "rolling": rolling(),
        "coming_to_rest": [coming_to_rest(name, way) for name in ("mug", "bell") for way in WAYS],
        "ringing": [quickest(lambda n=n: ringing(mug, n)) for n in BODIES],
        "hundred_modes": {"full": quickest(lambda: ringing(with_modes(MODES), 20))},
    }
    settings = {"seconds": SECONDS, "step_s": STEP_S, "block": BLOCK, "rate_hz": RATE_HZ, "runs": RUNS}
    conclude("live", figures, settings, COMPARED)
