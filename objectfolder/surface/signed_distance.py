"""The signed distance of a surface on a grid, and surfaces at a depth below it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from objectfolder.extras import needs_extra
from objectfolder.surface.connectivity import connected_pieces
from objectfolder.surface.surface import SampledDistance, Surface
from objectfolder.surface.winding_number import WindingNumber, is_closed

Floats = NDArray[np.float64]
MARGIN_CELLS = 2  # cells around the bounding box
CRUMB = 30.0  # cells: smaller closed pieces are not resolved


@dataclass(frozen=True)
class SignedDistance:
    """Depth at the nodes of a grid: positive inside.

    Attributes
    ----------
    depth : (nx, ny, nz)
    origin : (3,) of node (0, 0, 0)
    cell : edge of a cell
    """

    depth: Floats
    origin: Floats
    cell: float


def signed_distance(surface: Surface, nodes: int, *, level: float = 0.0) -> SignedDistance:
    """Depth below a surface, closed or not, on a grid of about `nodes` nodes.

    Inside is where the winding number is above a half. Near `level` the distance is exact, elsewhere that to
    the nearest of many samples.
    """
    low, high = surface.bounds
    size = np.maximum(high - low, 1e-3 * (high - low).max())
    cell = float((np.prod(size) / nodes) ** (1 / 3))
    while True:
        counts = np.ceil(size / cell).astype(np.int64) + 1 + 2 * MARGIN_CELLS
        if np.prod(counts) <= 1.1 * nodes + 1000:
            break
        cell *= 1.05
    origin = (low + high) / 2 - (counts - 1) * cell / 2
    grid = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3)
    points = origin + cell * grid
    distance = surface.sampled_distance.roughly(points)
    spacing = float(np.sqrt(surface.area / 20000))
    band = np.abs(distance - abs(level)) < 3 * cell + 3 * spacing
    distance[band] = surface.sampled_distance.nearest(points[band])[1]
    inside = _inside(surface, points, distance.reshape(tuple(counts)), cell / 2 + 2 * spacing)
    return SignedDistance(np.where(inside, distance, -distance).reshape(tuple(counts)), origin, cell)


def _inside(surface: Surface, points: Floats, distance: Floats, clear: float) -> NDArray[np.bool_]:
    """Whether (n,) grid points are inside; neighbours `clear` of a closed surface are on one side of it."""
    winding = WindingNumber(surface)
    if not is_closed(surface):
        return np.asarray(winding(points) > 0.5)
    region, regions = label(distance > clear)
    region = region.ravel()
    result = np.zeros(len(points), dtype=bool)
    near = region == 0
    result[near] = winding(points[near]) > 0.5
    _, first = np.unique(region, return_index=True)
    first = first[-regions:] if regions else first[:0]
    of_region = np.concatenate([[False], winding(points[first]) > 0.5])
    result[~near] = of_region[region[~near]]
    return result


def surface_at_depth(surface: Surface, depth: float, *, nodes: int = 200_000) -> Surface | None:
    """The closed surface of all places at a depth inside another, faces outward; None if it has none.

    Marching cubes on the signed distance, whose vertices are then moved to that distance exactly, away from
    the nearest place. Pieces under 30 cells are left out.
    """
    with needs_extra("factory"):
        from skimage.measure import marching_cubes
    field = signed_distance(surface, nodes, level=depth)
    if float(field.depth.max()) <= depth:
        return None
    vertices, faces, _, _ = marching_cubes(field.depth, depth, gradient_direction="ascent")
    vertices = field.origin + field.cell * vertices.astype(np.float64)
    near = SampledDistance(surface, samples=50_000)
    for _ in range(2):
        place, distance, _ = near.nearest(vertices)
        step = (depth - distance) / np.maximum(distance, 1e-300)
        step = np.clip(step, -0.5 * field.cell / depth, 0.5 * field.cell / depth)
        vertices = vertices + step[:, None] * (vertices - place)
    faces = faces.astype(np.int64)
    corner = vertices[faces] - vertices.mean(axis=0)
    _, piece = connected_pieces(faces)
    volume = np.bincount(piece, np.linalg.det(corner) / 6)
    if volume[np.abs(volume).argmax()] < 0:
        faces, volume = faces[:, ::-1], -volume
    sizeable = volume[piece] > CRUMB * field.cell**3
    return Surface(vertices, faces[sizeable]) if sizeable.any() else None
