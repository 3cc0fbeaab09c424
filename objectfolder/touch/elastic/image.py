"""What the camera sees of a deformed gel: colour, displacement, contact."""

import numpy as np

from objectfolder.touch.elastic.membrane import Membrane, Seen, trace_membrane
from objectfolder.touch.rendering.backends import choose_backend
from objectfolder.touch.rendering.image import DEPTH_STEPS_PER_M
from objectfolder.touch.sensor.camera import RayGrid, resolve, to_bytes
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import shade


def membrane_image(
    membrane: Membrane, sensor: Sensor, grid: RayGrid, backend: str | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Image of the deformed gel by the sensor's own shading.

    Parameters
    ----------
    membrane
        The gel.
    grid
        The camera's rays, one or more a pixel.
    backend
        See `objectfolder.touch.rendering.backends.choose_backend`.

    Returns
    -------
    tuple
        rgb (height, width, 3) uint8; depth (height, width) float32 metres, the displacement of the membrane
        where a pixel sees it, negative where it bulges out, in steps as the rigid depth maps have; mask
        (height, width) bool, whether at least half of a pixel's samples see the gel touched.
    """
    seen = _trace(membrane, sensor, grid, backend)
    values = grid.gel_values.copy()
    values[seen.sample] = shade(sensor, seen.position, seen.normal)
    depth = np.zeros(len(values))
    depth[seen.sample] = seen.displacement
    touched = np.zeros(len(values), dtype=np.float32)
    touched[seen.sample] = seen.touched
    depth_map = resolve(depth, sensor, grid.samples)
    return (
        to_bytes(resolve(values, sensor, grid.samples)),
        (np.trunc(depth_map * DEPTH_STEPS_PER_M) / DEPTH_STEPS_PER_M).astype(np.float32),
        resolve(touched, sensor, grid.samples) >= 0.5,
    )


def _trace(membrane: Membrane, sensor: Sensor, grid: RayGrid, backend: str | None) -> Seen:
    if choose_backend(backend) == "compiled":
        from objectfolder.touch.elastic import compiled_membrane

        return compiled_membrane.trace_membrane(membrane, sensor, grid)
    return trace_membrane(membrane, sensor, grid)
