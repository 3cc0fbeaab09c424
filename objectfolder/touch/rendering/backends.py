"""The ways to compute a touch, and which of them is taken."""

import importlib.util
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol

import numpy as np

from objectfolder.errors import QueryError

if TYPE_CHECKING:
    from objectfolder.touch.contact.patch import FacePatches
    from objectfolder.touch.sensor.sensor import Sensor

BACKENDS = ("compiled", "reference")


@dataclass(frozen=True)
class Near:
    """Faces near the gel at a pose.

    Parameters
    ----------
    faces, triangles
        (m,) indices and (m, 3, 3) corners in the sensor frame, metres.
    bounds
        (m,) what the indentation of the gel by each face does not exceed, metres.
    greatest
        Largest indentation by any of them, at least 0.
    """

    faces: np.ndarray
    triangles: np.ndarray
    bounds: np.ndarray
    greatest: float

    def advanced(self, distance: float) -> "Near":
        """What they are after the sensor has moved on along its axis by `distance` metres."""
        triangles = self.triangles - np.array([distance, 0.0, 0.0])
        return Near(self.faces, triangles, self.bounds + distance, self.greatest + distance)


class Simulator(Protocol):
    """What every way answers, for one surface, one sensor and a number of samples."""

    def stand(
        self, points: np.ndarray, tilt: np.ndarray, azimuth: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the touched points (n, 3), mean normals (n, 3) and poses of first touch (n, 4, 4).

        `tilt` and `azimuth` are (n,) radians.
        """
        ...

    def approach(self, pose: np.ndarray, least: float) -> Near:
        """Return the faces that may reach deeper into the gel than `least` metres, 0 or less, at a pose."""
        ...

    def meets_housing(self, pose: np.ndarray) -> bool:
        """Whether the object enters the housing."""
        ...

    def see(
        self, pose: np.ndarray, near: Near, rgb: np.ndarray, depth: np.ndarray, mask: np.ndarray
    ) -> float:
        """Write the image, depth map and mask of one touch; return the area seen in the gel, square metres.

        Faces whose bound is not above 0 are left out.
        """
        ...


@lru_cache(maxsize=1)
def _compiles() -> bool:
    return importlib.util.find_spec("numba") is not None


def choose_backend(backend: str | None) -> str:
    """Return the name of the way to compute touches.

    Parameters
    ----------
    backend
        ``"compiled"``, kernels compiled by numba; ``"reference"``, numpy alone. None stands for the
        first where it can be had, else for the second.

    Raises
    ------
    QueryError
        A name that is not known, or a way that is not at hand.
    """
    if backend is None:
        return "compiled" if _compiles() else "reference"
    if backend not in BACKENDS:
        raise QueryError("backend", f"{backend!r}", f"Use {' or '.join(map(repr, BACKENDS))}.")
    if backend == "compiled" and not _compiles():
        raise QueryError("backend", "'compiled' needs numba", "Install it, or use 'reference'.")
    return backend


def make_simulator(backend: str | None, patches: "FacePatches", sensor: "Sensor", samples: int) -> Simulator:
    """Return the simulator of that name; what it needs is imported here."""
    if choose_backend(backend) == "compiled":
        from objectfolder.touch.compiled import CompiledSimulator

        return CompiledSimulator(patches, sensor, samples)
    from objectfolder.touch.rendering.reference_simulator import ReferenceSimulator

    return ReferenceSimulator(patches, sensor, samples)
