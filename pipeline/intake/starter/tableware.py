"""A bowl, a plate and a mug with a handle."""

import numpy as np

from objectfolder.surface.textured_mesh import TexturedMesh
from pipeline.intake.starter.patterns import (
    between,
    flat,
    paint,
    smooth_noise,
    smooth_step,
    to_texture,
    unit_square,
)
from pipeline.intake.starter.revolution import Revolution, resampled, revolve, shell_profile
from pipeline.intake.starter.shape import Shape, join, quads


def bowl() -> TexturedMesh:
    """Spherical cap: rim radius 79.5 mm, height 53 mm, wall 3 mm; rings and petals on a speckled glaze."""
    rim_radius, height, wall = 0.0795, 0.053, 0.003
    radius = (rim_radius**2 + height**2) / (2 * height)
    angle = np.linspace(0, np.arccos((radius - height) / radius), 19)
    outer = np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle))], axis=1)
    # The ends of a numerical tangent would tilt the wall; a sphere's offset is a sphere.
    inner = outer + (wall / radius) * (np.array([0, radius]) - outer)
    turn = np.linspace(0, np.pi, 5)[1:-1, None]
    outward = (outer[-1] - inner[-1]) / wall
    along = np.array([-outward[1], outward[0]])
    rim = (outer[-1] + inner[-1]) / 2 + wall / 2 * (np.cos(turn) * outward + np.sin(turn) * along)
    surface = revolve(np.concatenate([outer, rim, inner[::-1]]), segments=72).surface()

    u, v = unit_square()
    image = flat((0.90, 0.86, 0.76))
    image = paint(image, (0.55, 0.42, 0.30), 0.8 * between(smooth_noise(40, 24, 11, 2), 0.68, 2.0, 0.1))
    petal = 0.33 + 0.09 * np.abs(np.sin(8 * np.pi * u))
    image = paint(image, (0.12, 0.25, 0.55), between(v, 0.24, 0.26) + between(v, 0.45, 0.475))
    image = paint(image, (0.16, 0.42, 0.55), between(v, 0.29, 1.0) * smooth_step((petal - v) / 0.004))
    image = paint(image, (0.10, 0.45, 0.40), between((v * 14) % 1, 0.35, 0.65, 0.05) * between(v, 0.55, 0.93))
    return surface.textured(to_texture(image))


def plate() -> TexturedMesh:
    """Plate of 200 mm with a raised rim, 4.5 mm thick; rings of dots on green."""
    radius = np.linspace(0, 0.098, 200)
    height = 0.017 * smooth_step((radius - 0.058) / 0.045)
    outer = resampled(np.stack([radius, height], axis=1), 20)
    surface = revolve(shell_profile(outer, 0.0045), segments=72).surface()

    u, v = unit_square()
    image = flat((0.35, 0.62, 0.52)) + 0.12 * (smooth_noise(10, 10, 21) - 0.5)[..., None]
    image = paint(image, (0.88, 0.95, 0.90), between(v, 0.52, 0.535) + between(v, 0.70, 0.715))
    for ring, count in ((0.58, 36), (0.64, 24)):
        around = ((u * count) % 1 - 0.5) / count
        distance = np.hypot(around * 6.0 * (1 - ring), 1.2 * (v - ring))
        image = paint(image, (0.95, 0.75, 0.25), smooth_step((0.016 - distance) / 0.003))
    image = paint(image, (0.10, 0.28, 0.25), between((u * 12) % 1, 0.0, 0.5, 0.02) * between(v, 0.12, 0.40))
    return surface.textured(to_texture(image))


SEGMENTS, TUBE_RINGS = 60, 34
"""Of the mug: columns around the wall, rings along the handle."""

_PATCH_COLUMNS, _PATCH_ROWS = 4, 3
"""Cells of the wall that an end of the handle takes the place of."""


def mug() -> TexturedMesh:
    """Mug of 82 mm with a handle, 95 mm high, wall 3.5 mm; checks and stripes.

    The wall is a grid of quads; two patches of it are left out and the handle, a tube of rings with as many
    vertices as a patch's outline, is sewn in between: one closed surface without a boolean operation.
    """
    radius, height, wall, corner = 0.041, 0.0935, 0.0035, 0.007
    turn = np.linspace(0, np.pi / 2, 6)[1:-1]
    outer = np.concatenate(
        [
            np.stack([np.linspace(0, radius - corner, 8), np.zeros(8)], axis=1),
            np.stack([radius - corner * (1 - np.sin(turn)), corner * (1 - np.cos(turn))], axis=1),
            np.stack([np.full(24, radius), np.linspace(corner, height, 24)], axis=1),
        ]
    )
    body = revolve(shell_profile(outer, wall), SEGMENTS, v_range=(0.01, 0.80))
    first_wall_row = len(outer) - 24
    lower, upper = first_wall_row + 3, first_wall_row + 15
    column = SEGMENTS - _PATCH_COLUMNS // 2
    cells = np.ones((len(body.rings) - 1, SEGMENTS), dtype=bool)
    columns = (column + np.arange(_PATCH_COLUMNS)) % SEGMENTS
    for row in (lower, upper):
        cells[row : row + _PATCH_ROWS, columns] = False
    handle = _handle(body, upper, lower, column, radius)
    surface = join(np.concatenate([body.vertices, handle.vertices]), [body.surface(cells), handle])

    u, v = unit_square()
    image = flat((0.93, 0.91, 0.86)) + 0.05 * (smooth_noise(16, 16, 31) - 0.5)[..., None]
    checks = (np.floor(u * 24) + np.floor(v * 50)) % 2
    image = paint(image, (0.70, 0.16, 0.14), checks * between(v, 0.22, 0.32))
    image = paint(
        image, (0.15, 0.22, 0.42), between((u * 20 + 6 * v) % 1, 0.0, 0.4, 0.03) * between(v, 0.36, 0.41)
    )
    image = paint(image, (0.25, 0.45, 0.62), between(v, 0.43, 0.80))
    image = paint(image, (0.85, 0.82, 0.60), between((v * 40) % 1, 0.3, 0.6, 0.05) * between(v, 0.50, 0.66))
    image = paint(image, (0.70, 0.16, 0.14), between(v, 0.82, 1.0) * between((u * 12) % 1, 0.0, 0.5, 0.02))
    return surface.textured(to_texture(image))


def _handle(body: Revolution, upper: int, lower: int, column: int, radius: float) -> Shape:
    """Tube from the upper patch of the wall to the lower one along half an ellipse."""
    outline = _outline_of_patch()
    segments = body.rings.shape[1] - 1
    ends = []
    for row, mirrored in ((upper, False), (lower, True)):
        steps = [(_PATCH_ROWS - up if mirrored else up, side) for up, side in outline]
        ends.append(np.array([body.rings[row + up, (column + side) % segments] for up, side in steps]))
    start, end = body.vertices[ends[0]], body.vertices[ends[1]]
    middles = [(points[:, 2].min() + points[:, 2].max()) / 2 for points in (start, end)]
    middle, half_height = (middles[0] + middles[1]) / 2, (middles[0] - middles[1]) / 2
    rectangle = np.stack([start[:, 1], start[:, 2] - middles[0]], axis=1)
    angle = np.arctan2(rectangle[:, 1] / np.ptp(rectangle[:, 1]), rectangle[:, 0] / np.ptp(rectangle[:, 0]))
    ellipse = np.stack([0.0070 * np.cos(angle), 0.0045 * np.sin(angle)], axis=1)

    reach = 0.032
    rings = []
    for turn in np.pi * np.arange(1, TUBE_RINGS) / TUBE_RINGS:
        centre = np.array([radius + reach * np.sin(turn), 0, middle + half_height * np.cos(turn)])
        tangent = np.array([reach * np.cos(turn), 0, -half_height * np.sin(turn)])
        tangent /= np.linalg.norm(tangent)
        normal = np.array([-tangent[2], 0, tangent[0]])
        blend = smooth_step(np.minimum(turn, np.pi - turn) / 0.9)
        offset = (1 - blend) * rectangle + blend * ellipse
        rings.append(centre + offset[:, :1] * np.array([0, 1, 0]) + offset[:, 1:] * normal)
    count = len(outline)
    inner = len(body.vertices) + np.arange((TUBE_RINGS - 1) * count).reshape(-1, count)
    indices = np.concatenate([ends[0][None], inner, ends[1][None]])
    indices = np.concatenate([indices, indices[:, :1]], axis=1)
    u, v = np.linspace(0.02, 0.98, TUBE_RINGS + 1), np.linspace(0.83, 0.98, count + 1)
    coordinates = np.stack(np.broadcast_arrays(u[:, None], v[None, :]), axis=-1)
    part = quads(indices, coordinates)
    return Shape(np.concatenate(rings), part.faces, part.texture_coordinates)


def _outline_of_patch() -> list[tuple[int, int]]:
    """Steps (up, side) around a patch of the wall, counter-clockwise seen from outside."""
    right = [(0, side) for side in range(_PATCH_COLUMNS)]
    up = [(row, _PATCH_COLUMNS) for row in range(_PATCH_ROWS)]
    left = [(_PATCH_ROWS, _PATCH_COLUMNS - side) for side in range(_PATCH_COLUMNS)]
    down = [(_PATCH_ROWS - row, 0) for row in range(_PATCH_ROWS)]
    return right + up + left + down
