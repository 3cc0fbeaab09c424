"""A bell with a knob, mouth down."""

import numpy as np

from objectfolder.surface.textured_mesh import TexturedMesh
from pipeline.intake.starter.patterns import between, flat, paint, smooth_noise, to_texture, unit_square
from pipeline.intake.starter.revolution import resampled, revolve

_OUTSIDE_MM = np.array(
    [[0, 100], [5, 99.4], [8.2, 96], [8.8, 92], [7.2, 87.5], [5.5, 84], [5.6, 81], [9, 79], [16, 77.5],
     [21.5, 74], [24.5, 68], [26, 58], [27.5, 46], [30, 32], [34, 18], [39.5, 7], [45, 0]]
)  # fmt: skip
_INSIDE_MM = np.array(
    [[42.5, 0], [40, 3], [35.4, 8.5], [30.4, 19], [26.6, 33], [24.2, 46.5], [22.8, 58], [21.4, 66],
     [18, 71.4], [12, 73.8], [0, 74]]
)  # fmt: skip


def bell() -> TexturedMesh:
    """Bell of 90 mm at the mouth, 100 mm high, wall 3 mm at the waist; bands and studs on dark iron."""
    outside, inside = resampled(_OUTSIDE_MM, 32)[::-1], resampled(_INSIDE_MM, 22)[::-1]
    outside[-1, 0] = inside[0, 0] = 0.0
    profile = np.concatenate([inside, outside]) / 1000
    surface = revolve(profile, segments=64).surface()

    u, v = unit_square()
    rough = smooth_noise(24, 24, 41)
    image = flat((0.24, 0.24, 0.26)) + 0.18 * (rough - 0.5)[..., None]
    image = paint(image, (0.46, 0.24, 0.13), 0.9 * between(smooth_noise(9, 9, 42), 0.58, 2.0, 0.12))
    image = paint(
        image, (0.72, 0.58, 0.25), between(v, 0.47, 0.49) + between(v, 0.57, 0.58) + between(v, 0.74, 0.76)
    )
    studs = np.hypot(((u * 16) % 1 - 0.5) / 1.2, (v - 0.53) * 14)
    image = paint(image, (0.80, 0.78, 0.72), between(studs, -1.0, 0.25, 0.04))
    image = paint(
        image, (0.15, 0.30, 0.28), between((u * 8 + 3 * v) % 1, 0.0, 0.3, 0.02) * between(v, 0.60, 0.72)
    )
    return surface.textured(to_texture(image))
