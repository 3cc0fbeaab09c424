"""Collision shapes: a surface as convex parts, and how far these are from it.

The parts come from CoACD (Wei, Liu, Ling and Su, "Approximate Convex Decomposition for 3D Meshes with
Collision-Aware Concavity and Tree Search", SIGGRAPH 2022), run on a decimated copy with its threshold in
metres. What they cover is measured on the surface itself.
"""

import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from objectfolder.child_process import OUT_OF_TIME, last_words, run_module
from objectfolder.errors import InputError, UnsolvableError
from objectfolder.extras import missing_package
from objectfolder.surface.convex_parts import ConvexParts, convex_hull
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import WindingNumber

Floats = NDArray[np.float64]

# Concavity at which a part counts as convex, as a share of the longest side: the first of those that are
# tried. A finer one makes more parts than are asked for, which CoACD takes long to merge, and fits no better:
# a soup can's hulls cover .94 at .06 in 3 CPU seconds, .93 at .04 in 8, and .94 at .01 in 57.
THRESHOLD = 0.06
# A finer threshold is the last one times the share of parts that it made of this many as are asked for.
AIMED_PARTS = 1.2
LEAST_STEP, MOST_TRIALS = 1 / 3, 3
# Share of hulls or solid that is in both, and share of the parts asked for, at which no finer one is tried.
GOOD_UNION, GOOD_PARTS = 0.95, 0.9
MOST_PARTS = 16
# Share of its convex hull from which on an object is one part: CoACD cut a marble for ten minutes.
CONVEX = 0.97
# Of the decimated copy. CoACD's seconds grow with it, and the hulls of a scan hardly change: those of a
# hammer cover .906 with 1000 and .902 with 2000 faces.
DECIMATED_FACES = 1000
# Of a hull, or of all hulls where these are few. Simulators touch a plane at up to four corners of a hull;
# those of a scan lie so close together that bodies rock on them.
HULL_VERTICES, MOST_VERTICES_IN_ALL = 32, 128
# A hull flatter than this share of the longest side has no volume that simulators could use.
FLATTEST = 1e-4
# Of CoACD; among a hundred scans only a torn television takes longer.
COACD_LIMIT_S = 150
MEASURING_POINTS = 1 << 14
SURFACE_POINTS = 2000


def convex_parts(
    surface: Surface,
    *,
    threshold_m: float | None = None,
    most_parts: int = MOST_PARTS,
    most_faces: int = DECIMATED_FACES,
    seed: int = 0,
    name: str = "surface",
) -> ConvexParts:
    """Part a surface into convex hulls.

    Parameters
    ----------
    threshold_m
        Concavity below which a part is convex enough, metres; if None, ever finer ones are tried, and the
        hulls kept that cover the solid best, or a single part where it has 97 % of its convex hull.
    most_parts
        Largest number of hulls; a nearly convex object has fewer.
    most_faces
        The surface is decimated to this number of faces first.
    seed
        Of the search for cuts.
    name
        What errors call the object.

    Raises
    ------
    InputError
        Settings are out of range.
    MissingPackageError
        CoACD is not installed.
    UnsolvableError
        CoACD takes too long, or the parts have no volume.
    """
    if not most_parts >= 1:
        raise InputError(name, f"{most_parts} collision parts", "Ask for one or more.")
    length_m = float(np.ptp(surface.bounds, axis=0).max())
    if not (threshold_m is None or 0 < threshold_m <= length_m):
        raise InputError(name, f"a threshold of {threshold_m} m", "Give metres, above 0, at most its length.")
    if most_parts == 1 or (threshold_m is None and _solidity(surface) > CONVEX):
        return measure_parts(surface, _as_shapes([surface.vertices], length_m, name))
    less = _decimated(surface, most_faces)

    def parted(within_m: float) -> tuple[Surface, ...]:
        return _as_shapes(_hulls(less, within_m, most_parts, seed, name), length_m, name)

    if threshold_m is not None:
        return measure_parts(surface, parted(threshold_m))
    return measure_parts(surface, _best_of_finer(surface, parted, length_m, most_parts))


def _best_of_finer(
    surface: Surface, parted: Callable[[float], tuple[Surface, ...]], length_m: float, most_parts: int
) -> tuple[Surface, ...]:
    """Return the hulls of the largest union with the solid, of thresholds ever finer."""
    points = _in_box(*surface.bounds)
    inside = WindingNumber(surface)(points) > 0.5
    within_m, trials = THRESHOLD * length_m, []
    for _ in range(MOST_TRIALS):
        hulls = parted(within_m)
        union = _union_iou(inside, _covered(hulls, points))
        trials.append((union, hulls))
        if union >= GOOD_UNION or len(hulls) >= GOOD_PARTS * most_parts:
            break
        within_m *= max(len(hulls) / (AIMED_PARTS * most_parts), LEAST_STEP)
    return max(trials, key=lambda trial: trial[0])[1]


def measure_parts(surface: Surface, hulls: tuple[Surface, ...]) -> ConvexParts:
    """Return hulls with what they cover of the solid inside a surface."""
    low, high = surface.bounds
    for hull in hulls:
        low, high = np.minimum(low, hull.bounds[0]), np.maximum(high, hull.bounds[1])
    points = _in_box(low, high)
    solid = WindingNumber(surface)
    on_hulls = np.concatenate([_on_surface(hull, SURFACE_POINTS // len(hulls) + 1) for hull in hulls])
    out = on_hulls[solid(on_hulls) < 0.5]
    on_surface = _on_surface(surface, SURFACE_POINTS)
    bare = on_surface[~_covered(hulls, on_surface)]
    starts = np.cumsum([0, *(len(hull.vertices) for hull in hulls[:-1])])
    together = Surface(
        np.concatenate([hull.vertices for hull in hulls]),
        np.concatenate([hull.faces + start for hull, start in zip(hulls, starts, strict=True)]),
    )
    return ConvexParts(
        hulls,
        _union_iou(solid(points) > 0.5, _covered(hulls, points)),
        float(surface.closest_points(out).distance.max()) if len(out) else 0.0,
        float(together.closest_points(bare).distance.max()) if len(bare) else 0.0,
    )


def _in_box(low: Floats, high: Floats) -> Floats:
    """Return points (n, 3) spread evenly in a box."""
    from scipy.stats import qmc  # slow to import, and scenes of stored parts measure none

    return low + qmc.Sobol(3, seed=0).random(MEASURING_POINTS) * (high - low)


def _union_iou(inside: NDArray[np.bool_], covered: NDArray[np.bool_]) -> float:
    """Return how many points are in both solid and hulls, over those in either."""
    either = np.count_nonzero(inside | covered)
    return float(np.count_nonzero(inside & covered) / either) if either else 0.0


def _as_shapes(hulls: list[Floats], length_m: float, name: str) -> tuple[Surface, ...]:
    """Return hulls of the points (n, 3) of parts as simulators take them: with few corners, none flat."""
    convex = [hull for hull in map(convex_hull, hulls) if hull is not None]
    most = max(HULL_VERTICES, MOST_VERTICES_IN_ALL // max(len(convex), 1))
    thick = tuple(_thinned(hull, most) for hull in convex if _thickness(hull) > FLATTEST * length_m)
    if not thick:
        raise UnsolvableError(
            name, "its convex parts have no volume", "Check that the mesh encloses a solid."
        )
    return thick


def _solidity(surface: Surface) -> float:
    """Return the share of the convex hull that is solid."""
    points = _in_box(*surface.bounds)[: MEASURING_POINTS // 4]
    hull = convex_hull(surface.vertices)
    if hull is None:
        return 1.0
    within = points[_covered((hull,), points)]
    return float(np.mean(WindingNumber(surface)(within) > 0.5)) if len(within) else 1.0


def _thinned(hull: Surface, most_vertices: int) -> Surface:
    """Return a hull with at most that many vertices."""
    if len(hull.vertices) <= most_vertices:
        return hull
    for faces in range(2 * most_vertices - 4, 3, -2):  # first, of a closed surface with that many vertices
        fewer = convex_hull(_decimated(hull, faces).vertices)
        if fewer is not None and len(fewer.vertices) <= most_vertices:
            return fewer
    return hull


def _decimated(surface: Surface, most_faces: int) -> Surface:
    """Return a surface of at most that many faces, by quadric error metrics."""
    if len(surface.faces) <= most_faces:
        return surface
    import pyvista

    whole = pyvista.PolyData.from_regular_faces(surface.vertices, surface.faces)
    less = whole.decimate(1 - most_faces / len(surface.faces))
    return Surface(np.asarray(less.points, dtype=np.float64), np.asarray(less.regular_faces, dtype=np.int64))


def _hulls(surface: Surface, threshold_m: float, most_parts: int, seed: int, name: str) -> list[Floats]:
    if find_spec("coacd") is None:
        raise missing_package("coacd", "factory")
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "surface.npz", Path(folder) / "hulls.npz"
        settings = {"threshold_m": threshold_m, "most_parts": most_parts, "seed": seed}
        np.savez(
            source, vertices=surface.vertices, faces=surface.faces, time_limit_s=COACD_LIMIT_S, **settings
        )
        done = run_module("objectfolder.simulators.coacd_process", source, target)
        if done.returncode:
            what = f"ended with status {done.returncode}: {last_words(done.stderr)}"
            if done.returncode == OUT_OF_TIME:
                what = f"takes more than {COACD_LIMIT_S} CPU-s"
            remedy = "Mend its surface, or ask for one part, its convex hull."
            raise UnsolvableError(name, f"parting it into convex hulls {what}", remedy)
        with np.load(target) as hulls:
            return [hulls[key] for key in hulls.files]


def _thickness(hull: Surface) -> float:
    """Return the least extent of a hull along the normals of its faces, metres."""
    heights = hull.vertices @ hull.face_normals.T
    return float(np.ptp(heights, axis=0).min())


def _covered(hulls: tuple[Surface, ...], points: Floats) -> NDArray[np.bool_]:
    """Return which of (n, 3) points lie in one of the hulls."""
    covered = np.zeros(len(points), dtype=bool)
    for hull in hulls:
        boxed = np.all((points >= hull.bounds[0]) & (points <= hull.bounds[1]), axis=1)
        near = np.flatnonzero(boxed & ~covered)
        # Qhull's planes, for the normals of sliver faces are rounding errors.
        planes = ConvexHull(hull.vertices).equations
        covered[near] = np.all(points[near] @ planes[:, :3].T <= -planes[:, 3], axis=1)
    return covered


def _on_surface(surface: Surface, count: int) -> Floats:
    return np.concatenate([surface.vertices, surface.sample(count, seed=0).points])
