"""Volume and inertia as integrals over a closed surface, and what these count more than once.

That is where pieces overlap, or lie in one another. Along a column the winding number goes up by one at each
face that is entered and down at each that is left.
Where it is 2 or more, the space belongs to as many pieces. Columns are upright, one drawn in each cell of a
grid; along them the lengths are exact.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.openings import patches_of
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
COLUMNS_AT_ONCE = 16384
CELLS_AT_ONCE = 2_000_000
GAUSS = 0.5 / np.sqrt(3)  # from the middle over the length: two points integrate cubics exactly


@dataclass(frozen=True)
class SolidProperties:
    """Volume integrals over the enclosed solid for unit density; multiply by a density in kg/m^3 for masses.

    Parameters
    ----------
    volume_m3
        Signed sum over shells and cavities.
    volume_uncertainty_m3
        Standard error of it; 0 where no pieces overlap.
    centre_of_mass_m
        (3,) object frame.
    inertia_per_density_m5
        (3, 3) inertia tensor about the centre of mass, axes of the object frame.
    """

    volume_m3: float
    centre_of_mass_m: np.ndarray
    inertia_per_density_m5: np.ndarray
    volume_uncertainty_m3: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return the properties as JSON values."""
        return {
            "volume_m3": self.volume_m3,
            "volume_uncertainty_m3": self.volume_uncertainty_m3,
            "centre_of_mass_m": self.centre_of_mass_m.tolist(),
            "inertia_per_density_m5": self.inertia_per_density_m5.tolist(),
        }


@dataclass(frozen=True)
class CountedAgain:
    """What is to be taken away from an integral over a closed surface, as points.

    Attributes
    ----------
    points : (n, 3)
    volumes : (n,) cubic units of length
    uncertainty : standard error of their sum
    """

    points: Floats
    volumes: Floats
    uncertainty: float


NOTHING = CountedAgain(np.zeros((0, 3)), np.zeros(0), 0.0)


def solid_properties(
    vertices: np.ndarray, faces: np.ndarray, again: CountedAgain = NOTHING
) -> SolidProperties:
    """Integrate over the solid bounded by a closed, consistently wound surface.

    Sums over the tetrahedra from one point to each face (Tonon 2005, J. Math. Stat. 1(1), 8-11): with
    ``s = a + b + c`` and ``d = det(a, b, c)`` a tetrahedron adds ``d / 6`` to the volume, ``d s / 24`` to the
    first and ``d (s s' + a a' + b b' + c c') / 120`` to the second moment. On an open surface the sums depend
    on that point, here the centre of the bounding box, and mean nothing.

    Parameters
    ----------
    vertices, faces
        (V, 3) metres and (F, 3).
    again
        What the sums count more than once, and is taken away (see `counted_again`).
    """
    origin = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    triangles = vertices[faces] - origin
    determinants = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2]))
    sums = triangles.sum(axis=1)
    points = again.points - origin
    volume = float(determinants.sum() / 6 - again.volumes.sum())
    # Sums of numpy: a product of matrices would round as the processor's library does.
    first = (determinants[:, None] * sums).sum(axis=0) - 24 * (again.volumes[:, None] * points).sum(axis=0)
    centre = first / (24 * volume) if volume else np.zeros(3)
    outer = np.einsum("i,ij,ik->jk", determinants, sums, sums)
    outer += np.einsum("i,ivj,ivk->jk", determinants, triangles, triangles)
    second = outer / 120 - np.einsum("i,ij,ik->jk", again.volumes, points, points)
    moments = second - volume * np.outer(centre, centre)
    inertia = np.trace(moments) * np.eye(3) - moments
    return SolidProperties(volume, origin + centre, inertia, again.uncertainty)


def counted_again(surface: Surface, *, columns: int = COLUMNS_AT_ONCE, seed: int = 0) -> CountedAgain:
    """Where patches of a closed surface with outward faces overlap, and how often too much.

    A surface of which no two patches have bounding boxes that meet counts nothing again. Of two boxes along
    the axes the overlap is exact.

    Examples
    --------
    >>> from trimesh.creation import box
    >>> bars = box((4, 1, 1)) + box((1, 4, 1))
    >>> again = counted_again(Surface(bars.vertices, bars.faces))
    >>> round(float(again.volumes.sum()), 9), again.uncertainty < 1e-9
    (1.0, True)
    """
    box = _common_box(surface)
    if box is None:
        return NOTHING
    low, size = box[0][:2], (box[1] - box[0])[:2]
    counts = np.maximum(1, np.round(size * np.sqrt(columns / np.prod(size)))).astype(np.int64)
    counts = np.minimum(counts, columns)
    at = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1)
    places = low + (at + np.random.default_rng(seed).random(at.shape)) * size / counts
    column, height, step = _crossings(surface, low, size / counts, places)
    if len(column) == 0:
        return NOTHING
    order = np.lexsort((height, column))
    column, height, step = column[order], height[order], step[order]
    within = column[1:] == column[:-1]
    total = np.cumsum(step)
    first = np.searchsorted(column, column)
    times = np.where(within, (total - (total - step)[first])[:-1] - 1, 0)
    again = np.flatnonzero(times > 0)
    length, middle = height[again + 1] - height[again], (height[again + 1] + height[again]) / 2
    ends = middle + length * GAUSS * np.array([[-1.0], [1.0]])
    ground = np.tile(places.reshape(-1, 2)[column[again]], (2, 1))
    each = float(np.prod(size / counts))
    volumes = each * times[again] * length
    of_column = np.bincount(column[again], volumes, int(np.prod(counts)))
    error = float(of_column.std()) * np.sqrt(len(of_column))
    return CountedAgain(np.column_stack([ground, ends.ravel()]), np.tile(volumes / 2, 2), error)


def _common_box(surface: Surface) -> tuple[Floats, Floats] | None:
    """Lower and upper corner (3,) around all that the bounding boxes of any two patches have in common."""
    patch = patches_of(surface.edges)
    count = int(patch.max()) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    corners = surface.vertices[surface.faces]
    np.minimum.at(low, patch, corners.min(axis=1))
    np.maximum.at(high, patch, corners.max(axis=1))
    order = np.argsort(low[:, 0], kind="stable")
    low, high = low[order], high[order]
    boxes = []
    for index, end in enumerate(np.searchsorted(low[:, 0], high[:, 0])):
        lower = np.maximum(low[index], low[index + 1 : end])
        upper = np.minimum(high[index], high[index + 1 : end])
        meet = (lower < upper).all(axis=1)
        if meet.any():
            boxes.append((lower[meet].min(axis=0), upper[meet].max(axis=0)))
    if not boxes:
        return None
    lowest, highest = np.array(boxes).swapaxes(0, 1)
    return lowest.min(axis=0), highest.max(axis=0)


def _crossings(
    surface: Surface, low: Floats, cell: Floats, places: Floats
) -> tuple[Integers, Floats, Integers]:
    """Column, height and step of the winding number of each crossing of a face with a column, (n,) each.

    Parameters
    ----------
    low, cell
        (2,) corner of the grid, and sides of its cells.
    places
        (n, m, 2) the column in each cell.
    """
    corners = surface.vertices[surface.faces]
    shape = np.array(places.shape[:2])
    first = np.clip(np.floor((corners[:, :, :2].min(axis=1) - low) / cell), 0, shape).astype(np.int64)
    last = np.clip(np.ceil((corners[:, :, :2].max(axis=1) - low) / cell), 0, shape).astype(np.int64)
    cells = np.prod(last - first, axis=1)
    crossings = []
    starts = np.searchsorted(np.cumsum(cells), np.arange(0, cells.sum(), CELLS_AT_ONCE))
    for faces in np.split(np.arange(len(cells)), starts[1:]):
        face = np.repeat(faces, cells[faces])
        number = np.arange(len(face)) - np.repeat(np.cumsum(cells[faces]) - cells[faces], cells[faces])
        width = (last - first)[face, 1]
        row, line = first[face, 0] + number // width, first[face, 1] + number % width
        crossings.append(_crossed(corners[face], places[row, line], row * shape[1] + line))
    return tuple(np.concatenate(parts) for parts in zip(*crossings, strict=True))


def _crossed(corners: Floats, places: Floats, column: Integers) -> tuple[Integers, Floats, Integers]:
    """Of triangles (n, 3, 3) and columns at (n, 2), those that cross: column, height and step."""
    away = corners[:, :, :2] - places[:, None]
    after = np.roll(away, -1, axis=1)
    # Twice the areas that the column makes with each side, and the corner across from it.
    areas = np.roll(away[..., 0] * after[..., 1] - away[..., 1] * after[..., 0], -1, axis=1)
    inside = (areas > 0).all(axis=1) | (areas < 0).all(axis=1)
    areas, total = areas[inside], areas[inside].sum(axis=1)
    height = np.einsum("nk,nk->n", areas, corners[inside, :, 2]) / total
    return column[inside], height, -np.sign(total).astype(np.int64)
