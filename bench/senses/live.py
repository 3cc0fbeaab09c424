"""How much faster than real time objects are heard in a running simulation, on one core.

    OMP_NUM_THREADS=1 python -m bench.senses.live

A mug and a bell of the package fall onto a plane and come to rest in MuJoCo, as cylinders of their masses;
then many bodies of one mug ring at once, each struck once a second. What takes the seconds is told apart.
"""

import os
from typing import Any

import numpy as np

import objectfolder
from bench.record import Stopwatch, arguments, conclude, save, subplots
from objectfolder.live import LiveSound, MujocoSimulation

SECONDS, STEP_S, RATE_HZ, BLOCK = 4.0, 0.002, 44100.0, 512
BODIES = (5, 10, 20, 40)
COMPARED = (
    "seconds of sound over CPU seconds of one core; physics, finding collisions and sound together or alone"
)


class Watched(MujocoSimulation):
    """A simulation whose own CPU seconds are counted."""

    def __init__(self, model: Any, data: Any, watch: Stopwatch) -> None:
        super().__init__(model, data)
        self._watch = watch

    def step(self) -> None:
        with self._watch.step("physics"):
            super().step()

    def touching(self) -> list[Any]:
        with self._watch.step("contacts"):
            return super().touching()


def falling(names: tuple[str, ...]) -> dict[str, Any]:
    """A few seconds of objects that fall by 10 cm."""
    import mujoco

    spec, files = mujoco.MjSpec(), {}
    spec.option.timestep = STEP_S
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    for place, name in enumerate(names):
        file = files[name] = objectfolder.example(name)
        low, high = file.surface.bounds
        (x, y, z), known = (high - low) / 2, file.description["body"]
        body = spec.worldbody.add_body(
            name=name, pos=[0.3 * place, 0, 0.1 - low[2]], quat=[0.98, 0.17, 0.1, 0]
        )
        body.add_freejoint()
        body.mass, body.ipos, body.explicitinertial = known["mass_kg"], known["centre_of_mass_m"], True
        (a, d, e), (_, b, f), (_, _, c) = known["inertia_kg_m2"]
        body.fullinertia = [a, b, c, d, e, f]
        middle = (low + high) / 2
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[min(x, y), z, 0], pos=middle)
    model, watch = spec.compile(), Stopwatch()
    for _ in range(2):  # the first compiles kernels
        watch.cpu_s.clear()
        live = LiveSound(Watched(model, mujoco.MjData(model), watch), files)
        with watch.step("all"):
            sound = np.concatenate([live.block() for _ in range(round(SECONDS * RATE_HZ / BLOCK))])
    length_s = len(sound) / RATE_HZ
    return {
        "objects": names,
        "collisions": len(live.impacts),
        "real_time_factor": length_s / watch.cpu_s["all"],
        "cpu_s_per_second": {name: spent / length_s for name, spent in watch.cpu_s.items()},
    }


def ringing(bodies: int) -> dict[str, Any]:
    """Bodies that ring at once."""
    file, watch = objectfolder.example("mug"), Stopwatch()
    points, normals = file.sample_contacts(bodies, seed=0)
    streams = [file.stream(RATE_HZ, listener=np.array([0.0, -0.5, 0.5])) for _ in range(bodies)]
    blocks = round(RATE_HZ / BLOCK)
    for _ in range(2):
        watch.cpu_s.clear()
        with watch.step("all"):
            for stream, point, normal in zip(streams, points, normals, strict=True):
                with watch.step("strikes"):
                    stream.strike(point, -0.1 * normal, pulse=1e-3)
            for _ in range(blocks):
                for stream in streams:
                    stream.block(BLOCK)
    length_s = blocks * BLOCK / RATE_HZ
    return {
        "bodies": bodies,
        "modes_of_a_body": len(file.modes.frequencies_hz),
        "real_time_factor": length_s / watch.cpu_s["all"],
        "cpu_s_per_second": {name: spent / length_s for name, spent in watch.cpu_s.items()},
    }


def draw(figures: dict[str, Any]) -> None:
    """Real-time factors."""
    figure, axes = subplots(figsize=(6, 4))
    rows = figures["ringing"]
    axes.loglog([row["bodies"] for row in rows], [row["real_time_factor"] for row in rows], "o-")
    axes.axhline(1.0, color="k", lw=1)
    axes.set(xlabel="bodies that ring at once", ylabel="times as fast as real time")
    save(figure, "live")


def main() -> None:
    arguments(__doc__).parse_args()
    figures = {
        "falling": [falling(names) for names in (("mug",), ("mug", "bell"))],
        "ringing": [ringing(bodies) for bodies in BODIES],
    }
    settings = {"seconds": SECONDS, "step_s": STEP_S, "block": BLOCK, "rate_hz": RATE_HZ}
    conclude(
        "live", figures, settings | {"threads": os.environ.get("OMP_NUM_THREADS", "all")}, COMPARED, draw
    )


if __name__ == "__main__":
    main()
