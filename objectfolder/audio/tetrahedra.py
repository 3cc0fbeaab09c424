"""The solid inside a surface, as tetrahedra: whatever the surface is like.

The surface is first simplified within an envelope, then filled by fTetWild (Hu, Schneider, Wang, Zorin and
Panozzo, "Fast Tetrahedral Meshing in the Wild", 2020), which takes holes, overlaps and several pieces: inside
is where the generalised winding number is large.
"""

import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from objectfolder.errors import InputError, SimulationError
from objectfolder.geometry.surface import Surface
from objectfolder.geometry.wall_thickness import wall_thickness

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
LOCAL_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])  # outward; face k is opposite corner k
SMALLEST_SHARE = 1e-3
PATIENCE = 10  # wall seconds for a CPU second: a busy machine must not change what comes out


@dataclass(frozen=True)
class Filling:
    """How a surface is filled.

    Attributes
    ----------
    edge_length : target edge over the diagonal of the bounding box; up to twice that for a bulky solid, where
        `bulk_elements` equal tetrahedra fill the volume
    bulk_elements : see `edge_length`
    epsilon_per_wall : envelope over the median wall thickness, and over 2/3 of its 5 % quantile by area
    simplification_per_wall : rms distance that simplification may move the surface, over the 5 % quantile
    target_faces : faces the surface is simplified to, more where that distance demands it
    most_faces : from here on 2.5 times that distance will do
    stop_energy : conformal AMIPS energy at which fTetWild stops improving elements (regular: 3)
    time_limit_s : CPU time after which the filling is started again coarser, and then given up
    """

    edge_length: float = 0.1
    bulk_elements: int = 800
    epsilon_per_wall: float = 1 / 15
    simplification_per_wall: float = 1 / 7
    target_faces: int = 800
    most_faces: int = 2500
    stop_energy: float = 100.0
    time_limit_s: float = 240.0


@dataclass(frozen=True)
class Solid:
    """Positively oriented tetrahedra in metres; bodies share no vertex.

    Attributes
    ----------
    vertices : (v, 3) float64
    tetrahedra : (t, 4) int64
    component : (v,) int64 body of each vertex; bodies are joined through faces only
    report : what was done, JSON-able
    """

    vertices: Floats
    tetrahedra: Integers
    component: Integers
    report: dict[str, Any]

    @property
    def components(self) -> int:
        """Number of bodies."""
        return int(self.component.max()) + 1

    @property
    def volume_m3(self) -> float:
        """Volume, cubic metres."""
        return float(volumes(self.vertices, self.tetrahedra).sum())

    def boundary(self) -> tuple[Integers, Integers, Integers]:
        """Outward boundary triangles (f, 3), the element (f,) and the opposite local corner (f,) of each."""
        faces = self.tetrahedra[:, LOCAL_FACES].reshape(-1, 3)
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        outer = np.sort(first[count == 1])
        return faces[outer], outer // 4, outer % 4


def volumes(vertices: Floats, tetrahedra: Integers) -> Floats:
    """Signed volume of each tetrahedron, (t,)."""
    corner = vertices[tetrahedra]
    return np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6


def fill(surface: Surface, filling: Filling | None = None, *, name: str = "surface") -> Solid:
    """Fill a surface: closed or open, of one or more pieces, overlapping or not.

    Parameters
    ----------
    surface
        Metres, outward faces.
    filling
        Resolution and envelope.
    name
        What to call the object in errors.

    Raises
    ------
    SimulationError
        When nothing came back within the time limit, twice, or the surface encloses no volume.
    """
    filling = filling or Filling()
    diagonal = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    wall = wall_thickness(surface, None)
    thin = wall.thin_m if wall.thin_m is not None else diagonal / 50
    median = wall.median_m if wall.median_m is not None else diagonal / 50
    thickness = min(1.5 * thin, median)
    epsilon = float(np.clip(thickness * filling.epsilon_per_wall, 1e-4 * diagonal, 1.5e-3 * diagonal))
    allowed = float(np.clip(thin * filling.simplification_per_wall, epsilon, 1.5e-3 * diagonal))
    signed = _signed_volume(surface)
    bulk = (8.5 * (signed or 0.0) / filling.bulk_elements) ** (1 / 3) / diagonal
    edge = float(np.clip(bulk, filling.edge_length, 2 * filling.edge_length))
    attempts = [
        (epsilon, allowed, filling.stop_energy),
        (2 * epsilon, 2 * allowed, 10 * filling.stop_energy),
    ]
    for envelope, movement, energy in attempts:
        raw = _run(surface, envelope, movement, energy, edge, filling)
        if raw is not None and len(raw["tetrahedra"]):
            break
    else:
        raise SimulationError(
            name,
            f"no solid came of filling it within {filling.time_limit_s:.0f} CPU-s a try"
            if raw is None
            else "it encloses no volume",
            "Check that the surface is closed or nearly so, or simplify it.",
        )
    report = {
        "filling": asdict(filling),
        "first_attempt": (envelope, movement, energy) == attempts[0],
        "edge_m": edge * diagonal,
        "epsilon_m": envelope,
        "wall_thin_m": wall.thin_m,
        "wall_median_m": wall.median_m,
        "simplified_faces": int(raw["faces"]),
        "simplification_moved_rms_m": float(raw["moved_m"]),
    }
    solid = clean(raw["vertices"], raw["tetrahedra"].astype(np.int64), report, name=name)
    solid.report["volume_error"] = None if signed is None else solid.volume_m3 / signed - 1
    return solid


def clean(vertices: Floats, tetrahedra: Integers, report: dict[str, Any], *, name: str = "solid") -> Solid:
    """Orient, drop flat elements and crumbs, and part bodies that touch only along edges or at points.

    A flat element has under 1e-12 of the cube of its longest edge; a crumb is a body with under 1e-3 of the
    volume. Joined bodies share faces: others would be hinged, and have fewer than six rigid motions each.
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    if len(tetrahedra) == 0 or not np.isfinite(vertices).all():
        raise InputError(name, "no tetrahedra, or coordinates that are not finite", "Check the mesh.")
    volume = volumes(vertices, tetrahedra)
    corner = vertices[tetrahedra]
    longest = np.max(np.linalg.norm(corner[:, :, None] - corner[:, None, :], axis=-1), axis=(1, 2))
    whole = np.abs(volume) > 1e-12 * longest**3
    inverted = volume < 0
    tetrahedra = np.where(inverted[:, None], tetrahedra[:, [0, 2, 1, 3]], tetrahedra)[whole]
    body = _bodies(tetrahedra)
    size = np.bincount(body, np.abs(volume[whole]))
    kept = size >= SMALLEST_SHARE * size.sum()
    number = np.cumsum(kept) - 1
    stays = kept[body]
    tetrahedra, body = tetrahedra[stays], number[body[stays]]
    key = body[:, None] * len(vertices) + tetrahedra
    unique, renumbered = np.unique(key, return_inverse=True)
    report = {
        **report,
        "flat_elements_dropped": int(np.count_nonzero(~whole)),
        "bodies": int(kept.sum()),
        "body_volume_shares": (size[kept] / size.sum()).tolist(),
        "crumbs_dropped": int(np.count_nonzero(~kept)),
        "crumbs_volume_share": float(size[~kept].sum() / size.sum()),
    }
    return Solid(
        vertices[unique % len(vertices)], renumbered.reshape(key.shape), unique // len(vertices), report
    )


def _bodies(tetrahedra: Integers) -> Integers:
    """Number the bodies joined through faces, (t,)."""
    faces = np.sort(tetrahedra[:, LOCAL_FACES].reshape(-1, 3), axis=1)
    _, label = np.unique(faces, axis=0, return_inverse=True)
    label = label.reshape(-1)
    order = np.argsort(label, kind="stable")
    same = np.flatnonzero(label[order][1:] == label[order][:-1])
    first, second = order[same] // 4, order[same + 1] // 4
    count = len(tetrahedra)
    graph = sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _signed_volume(surface: Surface) -> float | None:
    """Volume within a closed surface, None for one with open or unevenly shared edges."""
    faces = surface.faces
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forward = np.unique(edges, axis=0, return_counts=True)
    backward = np.unique(edges[:, ::-1], axis=0, return_counts=True)
    if not all(np.array_equal(a, b) for a, b in zip(forward, backward, strict=True)):
        return None
    corner = surface.vertices[faces] - surface.bounds.mean(axis=0)
    volume = float(np.linalg.det(corner).sum() / 6)
    return volume if volume > 0 else None


def _run(
    surface: Surface, epsilon: float, allowed: float, energy: float, edge: float, filling: Filling
) -> dict[str, NDArray[Any]] | None:
    """Fill in a child process; None when the time is up."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "surface.npz", Path(folder) / "solid.npz"
        np.savez(
            source,
            vertices=surface.vertices,
            faces=surface.faces,
            epsilon_m=epsilon,
            allowed_m=allowed,
            target_faces=filling.target_faces,
            most_faces=filling.most_faces,
            edge_length=edge,
            stop_energy=energy,
            time_limit_s=filling.time_limit_s,
        )
        command = [sys.executable, "-m", "objectfolder.audio.tetwild_process", str(source), str(target)]
        root = str(Path(__file__).parents[2])
        path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=PATIENCE * filling.time_limit_s,
                cwd=folder,  # fTetWild leaves files where it runs
                check=False,
                env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
            )
        except subprocess.TimeoutExpired:
            return None
        if done.returncode != 0:
            if done.returncode > 0:
                last = done.stderr.strip().splitlines()[-1:] or ["no message"]
                raise SimulationError("tetrahedra", f"the filling failed: {last[0]}", "Check the mesh.")
            return None
        with np.load(target) as result:
            return {key: result[key] for key in result.files}
