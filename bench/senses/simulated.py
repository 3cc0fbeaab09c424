"""What benches of a running simulation share: objects as bodies of MuJoCo, and its seconds by part."""

from contextlib import AbstractContextManager, nullcontext
from typing import Any

from bench.record import Stopwatch
from objectfolder.live import MujocoSimulation
from objectfolder.object_file import ObjectFile

STEP_S, RATE_HZ, BLOCK = 0.002, 44100.0, 512


class Watched(MujocoSimulation):
    """A simulation whose physics and contacts are timed from when it has a watch."""

    watch: Stopwatch | None = None

    def step(self) -> None:
        with self._timed("physics"):
            super().step()

    def touching(self) -> list[Any]:
        with self._timed("contacts"):
            return super().touching()

    def _timed(self, name: str) -> AbstractContextManager[None]:
        return self.watch.step(name) if self.watch else nullcontext()


def table() -> Any:
    """Return a plane, as a specification for MuJoCo."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.timestep = STEP_S
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    return spec


def add_body(spec: Any, name: str, file: ObjectFile, **pose: Any) -> Any:
    """Add a free body with an object's mass and inertia, without a shape, and return it."""
    inertial = file.description["body"]
    body = spec.worldbody.add_body(name=name, **pose)
    body.add_freejoint()
    body.mass, body.ipos, body.explicitinertial = inertial["mass_kg"], inertial["centre_of_mass_m"], True
    (a, d, e), (_, b, f), (_, _, c) = inertial["inertia_kg_m2"]
    body.fullinertia = [a, b, c, d, e, f]
    return body
