"""Walls that a scan made too thin, and sheets that bound nothing, brought to a stated thickness.

A closed container, scanned from outside and therefore solid, is made hollow.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from objectfolder.errors import InputError
from objectfolder.making.solid.local_thickness import distances_across
from objectfolder.surface.connectivity import edge_table
from objectfolder.surface.openings import LEAST_OPENING, apart, opening_shares, patches_of, rim_of
from objectfolder.surface.signed_distance import surface_at_depth
from objectfolder.surface.surface import Surface, corner_angles

SHELL_REMEDY = "Correct shell_m, or leave it empty for a solid object"


def hollow(surface: Surface, shell_m: float, name: str = "surface", *, nodes: int = 200_000) -> Surface:
    """The surface with a cavity: all that is deeper inside than `shell_m`.

    The outside stays as it is. Wherever the object is thicker than twice the shell it becomes a wall of that
    thickness, and the wall is closed everywhere: what is scanned closed (a bottle with its cap, a can) is a
    closed hollow body. What is thinner than twice the shell (a handle) stays solid.

    Parameters
    ----------
    surface
        Metres, faces outward; closed or nearly so.
    shell_m
        Thickness of the wall in metres.
    name
        What to call the object in errors.
    nodes
        Of the grid that the cavity is found on.

    Returns
    -------
    Surface
        The faces of `surface`, followed by those of the cavity, which face into it.

    Raises
    ------
    InputError
        A thickness that is not positive, or as thick as the object: nothing of it is deep enough to be empty.
    """
    if not (np.isfinite(shell_m) and shell_m > 0):
        raise InputError(f"{name}, shell_m", f"{shell_m!r} is not a positive number of metres", SHELL_REMEDY)
    if 2 * shell_m >= float(np.ptp(surface.bounds, axis=0).min()):
        inner = None
    else:
        inner = surface_at_depth(surface, shell_m, nodes=nodes)
    if inner is None:
        raise InputError(
            f"{name}, shell_m",
            f"a shell of {shell_m:g} m leaves nothing hollow: the object is nowhere thick enough",
            SHELL_REMEDY,
        )
    used, packed = np.unique(inner.faces, return_inverse=True)
    return Surface(
        np.concatenate([surface.vertices, inner.vertices[used]]),
        np.concatenate([surface.faces, packed.reshape(-1, 3)[:, ::-1] + len(surface.vertices)]),
    )


Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
WALL_REMEDY = "Correct wall_m, or leave it empty for the walls as scanned"
WALL_SAMPLES = 8000
CORNER = 0.8  # of the way from the middle of a face to a corner: where thickness is measured
SMOOTHINGS = 3  # steps to neighbours nearer than the wall is thick: scans are rough
THICKENING_STEPS = 1000
LONGEST_OFFSET = 2.0  # a corner of a cube moves by the root of 3
GAP_SHARE = 1 / 3  # of a gap, the most that the wall on one side of it may take


def thicken(surface: Surface, wall_m: float, name: str = "surface") -> tuple[Surface, float]:
    """Walls thinner than `wall_m` grown to it, by as much on either side.

    The rule: both faces of a wall move outwards along their normals by half of what is missing, so that its
    middle, which decides how it bends and how large it is, stays where it was scanned. A wall is where the
    surface on the other side faces away within 60 degrees; its rim goes with it, and places between walls and
    thicker parts move by a mean. What is thick enough stays; nothing becomes thinner. Neither face takes more
    than a third of the gap in front of it, so that no gap closes.

    An open patch with nothing behind it is a sheet, and becomes a wall with two sides (see `_thick_sheets`).

    Parameters
    ----------
    surface
        Metres, outward faces.
    wall_m
        Least thickness of walls in metres.
    name
        What to call the object in errors.

    Returns
    -------
    surface, share
        With the same faces but for sheets, and the share of its area that belonged to sheets and to walls
        that grew.

    Raises
    ------
    InputError
        A thickness that is not positive, or that is no wall's: more than a quarter of the middle one of the
        object's three sides.
    """
    if not (np.isfinite(wall_m) and wall_m > 0):
        raise InputError(f"{name}, wall_m", f"{wall_m!r} is not a positive number of metres", WALL_REMEDY)
    sides = np.sort(np.ptp(surface.bounds, axis=0))
    if wall_m > sides[1] / 4:
        raise InputError(
            f"{name}, wall_m",
            f"{wall_m:g} m is no wall of an object with sides of "
            + ", ".join(f"{side:.3g}" for side in sides[::-1])
            + " m",
            WALL_REMEDY,
        )
    drawn = surface.sample(WALL_SAMPLES, 0)
    thickness = _wall_at(surface, drawn.points, drawn.face)
    patch = patches_of(surface.edges)
    walled = np.bincount(patch[drawn.face], thickness < sides[1] / 4, patch.max() + 1)
    sheet = opening_shares(surface, patch) > LEAST_OPENING
    sheet &= walled <= np.bincount(patch[drawn.face], minlength=len(sheet)) / 2
    thin = thickness < wall_m
    share = float((thin | sheet[patch[drawn.face]]).mean())
    thin &= ~sheet[patch[drawn.face]]
    if thin.any():
        offset = _growth(surface, drawn.points[thin], wall_m)
        surface = Surface(surface.vertices + offset[:, None] * unit_offsets(surface), surface.faces)
    if sheet.any():
        surface = _thick_sheets(surface, sheet, patch, wall_m)
    return surface, share


def _wall_at(surface: Surface, points: Floats, faces: NDArray[np.int64]) -> Floats:
    """Thickness (n,) of the wall at points of faces (n,); infinite where there is no wall."""
    normals = surface.face_normals[faces]
    start = 1e-6 * float(np.ptp(surface.bounds, axis=0).max())
    hits = surface.ray_hits(points - start * normals, -normals)
    behind = surface.face_normals[np.maximum(hits.face, 0)]
    is_wall = (hits.face >= 0) & (np.einsum("ij,ij->i", normals, behind) < -0.5)
    return np.where(is_wall, start + hits.distance, np.inf)


def _growth(surface: Surface, thin: Floats, wall_m: float) -> Floats:
    """How far each vertex (v,) moves, by its faces' corners; points `thin` (n, 3) lie on thin walls."""
    count = len(surface.vertices)
    corner = surface.vertices[surface.faces]
    points = (CORNER * corner + (1 - CORNER) * corner.mean(axis=1, keepdims=True)).reshape(-1, 3)
    face, vertex = np.repeat(np.arange(len(surface.faces)), 3), surface.faces.reshape(-1)
    thickness = _wall_at(surface, points, face)
    growth = np.clip(wall_m - thickness, 0.0, wall_m) / 2
    # A rim faces the rim opposite, or nothing: it goes with the wall that ends in it.
    tells = (thickness < 2 * wall_m) | (cKDTree(thin).query(points)[0] > 1.5 * wall_m)
    weight = np.where(tells, corner_angles(surface.vertices, surface.faces).reshape(-1), 0.0)
    total = np.bincount(vertex, weight, count)
    value = np.bincount(vertex, weight * growth, count) / np.maximum(total, 1e-300)
    most = np.full(count, np.inf)
    gap = distances_across(surface, points, -surface.face_normals[face])
    np.minimum.at(most, vertex, GAP_SHARE * gap)

    edges = edge_table(surface.faces).vertices
    defined = total > 0
    for _ in range(THICKENING_STEPS):
        if defined.all():
            break
        mean, heard = _mean_of_neighbours(edges, value, defined)
        fresh = ~defined & heard
        if not fresh.any():
            break
        value[fresh], defined[fresh] = mean[fresh], True
    short = edges[np.linalg.norm(np.subtract(*surface.vertices[edges].swapaxes(0, 1)), axis=1) < wall_m]
    for _ in range(SMOOTHINGS):
        mean, heard = _mean_of_neighbours(short, value, defined)
        value[heard] = (value[heard] + mean[heard]) / 2
    return np.minimum(value, most)


def _mean_of_neighbours(
    edges: NDArray[np.int64], value: Floats, defined: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Mean (v,) of what is known at the other ends of the edges of each vertex, and where there is one."""
    start, end = np.concatenate([edges, edges[:, ::-1]]).T
    number = np.bincount(start, defined[end], len(value))
    total = np.bincount(start, np.where(defined[end], value[end], 0.0), len(value))
    return total / np.maximum(number, 1), number > 0


def _thick_sheets(surface: Surface, sheet: NDArray[np.bool_], patch: Integers, wall_m: float) -> Surface:
    """A surface whose sheets have two sides, `wall_m` apart about where they were, and rims between these.

    Parameters
    ----------
    sheet
        (p,) bool, of each patch: what is made thick. Others stay as they are.
    patch
        (f,) number of each face.
    wall_m
        Metres.
    """
    thick = sheet[patch]
    parted = apart(Surface(surface.vertices, surface.faces[thick]), patch[thick])
    offset = wall_m / 2 * unit_offsets(parted)
    count, rim = len(parted.vertices), rim_of(parted.faces)
    start, end = rim.T
    sides = np.concatenate(
        [
            np.column_stack([end, start, start + count]),
            np.column_stack([end, start + count, end + count]),
        ]
    )
    faces = np.concatenate([parted.faces, parted.faces[:, ::-1] + count, sides])
    rest = surface.faces[~thick]
    return Surface(
        np.concatenate([parted.vertices + offset, parted.vertices - offset, surface.vertices]),
        np.concatenate([faces, rest + 2 * count]),
    )


def unit_offsets(surface: Surface) -> Floats:
    """How each vertex (v, 3) moves when all faces at it move outwards by one: a normal, longer at creases.

    Least squares of the faces' distances, weighted by their angles; directions that the faces hardly differ
    in are left out, so that a rough surface is moved along its mean normal.
    """
    normals, angles = surface.face_normals, corner_angles(surface.vertices, surface.faces)
    matrix = np.zeros((len(surface.vertices), 3, 3))
    vector = np.zeros((len(surface.vertices), 3))
    for corner, angle in zip(surface.faces.T, angles.T, strict=True):
        np.add.at(matrix, corner, np.einsum("f,fi,fj->fij", angle, normals, normals))
        np.add.at(vector, corner, angle[:, None] * normals)
    offset = np.einsum("vij,vj->vi", np.linalg.pinv(matrix, rcond=0.1, hermitian=True), vector)
    length = np.linalg.norm(offset, axis=1, keepdims=True)
    return np.asarray(offset * np.minimum(1.0, LONGEST_OFFSET / np.maximum(length, 1e-300)))
