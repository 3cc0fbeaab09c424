"""Child process that fills a surface: ``python -m objectfolder.solid.tetwild_process IN OUT``.

A process of its own because the filling is native code without a way to stop it. IN and OUT are .npz files:
IN holds `vertices`, `faces` and the numbers of `tetwild.Envelope`; OUT holds `vertices`, `tetrahedra`, the
faces the surface was simplified to, by how much it moved, and the edge that was asked for.
"""

import os
import resource
import sys
from pathlib import Path

import numpy as np
import pytetwild
import pyvista
from numpy.typing import NDArray
from pytetwild import PyfTetWildWrapper

from objectfolder.child_process import end_with, limit_cpu_time
from objectfolder.solid.seeded_random_device import seed_random_device
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
# Faces over those aimed at, from which on elements are as many as order 4 is solved for: longer ones will do.
MANY_FACES = 1.8


def simplify(surface: Surface, target_faces: int, most_faces: int, allowed: float) -> tuple[Surface, float]:
    """Fewest faces (from `target_faces` on, 1.4 times a step) that keep the surface, and its rms movement.

    Quadric edge collapse (VTK). The measure is the root mean square over area of the distance between the two
    surfaces, both ways. Kept means within `allowed` and 1 % of the volume; from `most_faces` on, where more
    faces would cost more than they bring, within 2.5 times as much. A surface that cannot be kept is left
    as it is, with distance 0.
    """
    faces = target_faces
    volume = _signed_volume(surface)
    drawn = surface.sample(1024, 0).points
    while faces < len(surface.faces):
        mesh = pyvista.PolyData.from_regular_faces(surface.vertices, surface.faces)
        reduced = mesh.decimate(1 - faces / len(surface.faces), volume_preservation=True)
        candidate = Surface(np.asarray(reduced.points, dtype=np.float64), reduced.faces.reshape(-1, 4)[:, 1:])
        forth = candidate.sampled_distance.nearest(drawn)[1]
        back = surface.sampled_distance.nearest(candidate.sample(1024, 1).points)[1]
        moved = float(np.sqrt(np.mean(np.concatenate([forth, back]) ** 2)))
        patience = 2.5 if faces >= most_faces else 1.0
        lost = abs(_signed_volume(candidate) - volume)
        if moved <= patience * allowed and lost <= 0.01 * patience * abs(volume):
            return candidate, moved
        faces = most_faces if faces < most_faces < 1.4 * faces else int(1.4 * faces)
    return surface, 0.0


def _signed_volume(surface: Surface) -> float:
    corner = surface.vertices[surface.faces] - surface.bounds.mean(axis=0)
    return float(np.linalg.det(corner).sum() / 6)


def main(source: str, target: str) -> None:
    """Read, simplify, fill, write."""
    inputs = np.load(source)
    limit_cpu_time(int(inputs["time_limit_s"]))
    most = int(inputs["memory_limit"])
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    surface = Surface(inputs["vertices"], inputs["faces"])
    diagonal = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    seed_random_device(Path(PyfTetWildWrapper.__file__), 0)
    simple, moved = simplify(
        surface, int(inputs["target_faces"]), int(inputs["most_faces"]), float(inputs["allowed"])
    )
    many = len(simple.faces) >= MANY_FACES * int(inputs["target_faces"])
    edge = float(inputs["edge_length" if many else "wave_edge"])
    vertices, tetrahedra = pytetwild.tetrahedralize(
        simple.vertices,
        simple.faces.astype(np.int32),
        edge_length_fac=edge / diagonal,
        epsilon=float(inputs["epsilon"]) / diagonal,
        stop_energy=float(inputs["stop_energy"]),
        num_threads=1,
        quiet=True,
    )
    np.savez(
        target, vertices=vertices, tetrahedra=tetrahedra, faces=len(simple.faces), moved=moved, edge=edge
    )


if __name__ == "__main__":
    end_with(os.getppid())
    main(sys.argv[1], sys.argv[2])
