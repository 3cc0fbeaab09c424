"""Places of a surface seen from near it along given normals: never on the other side of a thin wall."""

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]


def facing_places(surface: Surface, points: Floats, normals: Floats, reach: Floats) -> tuple[Floats, Floats]:
    """Nearest place along either direction of a normal where the surface faces the same way.

    The nearest point of a thin wall is often on its other side. A place counts here only when the normal of
    the surface there is within 75 degrees of the one given.

    Parameters
    ----------
    points, normals
        (n, 3) points near the surface, and unit normals.
    reach
        (n,) how far to look.

    Returns
    -------
    places, signed_distances
        (n, 3), and (n,) along the normal: positive where the surface lies further out. Where there is no such
        place the point itself, at distance nan.
    """
    start = 1e-6 * float(np.ptp(surface.bounds, axis=0).max())
    best = np.full(len(points), np.nan)
    for sign in (1.0, -1.0):
        hits = surface.ray_hits(points - sign * start * normals, sign * normals)
        along = hits.distance - start
        facing = np.einsum("ij,ij->i", surface.face_normals[np.maximum(hits.face, 0)], normals) > 0.25
        found = (hits.face >= 0) & facing & (along <= reach) & ~(np.abs(best) <= np.abs(along))
        best[found] = sign * along[found]
    places = points + np.where(np.isnan(best), 0.0, best)[:, None] * normals
    return places, best
