"""How a gel leans at each pixel of its picture, by colours (photometric stereo).

Each pixel has the slopes whose shade is nearest to its colour (Yuan, Dong & Adelson 2017, Sensors 17(12)).
Steep ones cost a little: where a value saturates, or slopes change within a pixel, those of another shade may
be nearest.
"""

import numpy as np
from numpy.typing import NDArray

from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.gel import gel_slopes
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import shade

Floats = NDArray[np.float64]
SLOPES, STEEPEST_SLOPE = 25, 1.2
# Cost of a slope, of what it changes on the untouched gel.
FLATTENING, STEP, AT_A_TIME = 2e-3, 1e-3, 400_000


def pixel_places(sensor: Sensor, height: Floats) -> Floats:
    """Return where pixels see a gel that a height map displaces, (3, rows, columns), metres."""
    grid = ray_grid(sensor, 1)
    v, u = np.meshgrid(grid.v, grid.u, indexing="ij")
    along = grid.gel_depth.reshape(height.shape) - height
    return np.asarray(sensor.camera_position_m)[:, None, None] + along * np.stack([np.ones_like(u), u, v])


def pixel_slopes(
    sensor: Sensor, colours: Floats, changed: NDArray[np.bool_], place: Floats
) -> tuple[Floats, Floats]:
    """Rises (rows, columns) of the displacement from row to row and from column to column, by colours."""
    at, target = place[:, changed], colours[changed]
    gel = np.stack(gel_slopes(sensor, at[1], at[2]))

    def values(which: NDArray[np.intp], slope: Floats) -> Floats:
        normals = np.concatenate([-np.ones((1, len(which))), gel[:, which] - slope])
        return shade(sensor, at[:, which], normals).astype(np.float64)

    def response(slope: Floats) -> Floats:
        base = values(each, slope)
        moved = [(values(each, slope + STEP * axis[:, None]) - base) / STEP for axis in np.eye(2)]
        return np.stack(moved, axis=-1)

    def error(which: NDArray[np.intp], slope: Floats) -> tuple[Floats, Floats]:
        off = values(which, slope) - target[which]
        return off, np.sum(off**2, axis=1) + cost * np.sum(slope**2, axis=0)

    each = np.arange(len(target))
    best = np.zeros((2, len(target)))
    cost = FLATTENING * np.mean(np.sum(response(best) ** 2, axis=(1, 2))) / 2
    steps = np.tan(np.linspace(-1, 1, SLOPES) * np.arctan(STEEPEST_SLOPE))
    candidates = np.stack(np.meshgrid(steps, steps)).reshape(2, -1)
    count = candidates.shape[1]
    for part in np.array_split(np.arange(len(target)), -(-len(target) * count // AT_A_TIME)):
        _, misfit = error(np.repeat(part, count), np.tile(candidates, len(part)))
        best[:, part] = candidates[:, misfit.reshape(len(part), count).argmin(axis=1)]
    for _ in range(3):  # Gauss and Newton
        (off, misfit), slope = error(each, best), response(best)
        steep = np.einsum("nci,ncj->nij", slope, slope) + cost * np.eye(2)
        pull = np.einsum("nci,nc->ni", slope, off) + cost * best.T
        nearer = best - np.clip(np.linalg.solve(steep, pull[..., None])[..., 0].T, -0.1, 0.1)
        best = np.where(error(each, nearer)[1] < misfit, nearer, best)
    across, up = np.zeros((2, *changed.shape))
    across[changed], up[changed] = best
    (y_down, y_right), (z_down, z_right) = np.gradient(place[1]), np.gradient(place[2])
    return across * y_down + up * z_down, across * y_right + up * z_right
