"""Truth of sight away from a data set's own views: finer images, other distances of the lamp, environments.

Two cameras and a small part of an image each do, for what they show is how an answer fares there, not how it
differs from view to view. All conditions share cameras, directions of lamps and the point that is looked at.
"""

from typing import Any

import numpy as np

from objectfolder.making.views.cycles_process import render_series
from objectfolder.making.views.glass import with_alpha_apart
from objectfolder.making.views.passes import with_cast_coverage
from objectfolder.making.views.render_request import Scene, Shots
from objectfolder.products.store import Array
from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import look_at, pixel_rays, uniform_on_sphere
from objectfolder.vision.compositing import composite_on_white
from objectfolder.vision.conditions import CONDITIONS, RESOLUTION_PX
from objectfolder.vision.environment import named_map

# Pixels a side of the part of each image that is rendered.
PART_PX = 64
# Distance from the surface, unit frame, that a lamp keeps, and directions that are tried for it.
LAMP_CLEARANCE, LAMP_DIRECTIONS = 0.05, 256
# Every view is rendered twice, each time with this share of the paths of a held-out view.
PATH_SHARE = 1 / 8
# Paths of a noisy pixel over those of all, see `Shots.most_samples`.
MOST_PATH_TIMES = 8
CONDITION_NOISE_FLOOR = (
    "PSNR on white of the mean of two renders with independent seeds against the noise-free image: 6.02 dB "
    "above the PSNR between the two, over the pixels that the object covers by at least half"
)


NEAR_CONDITION = "near_lamp"


def render_conditions(
    scene: Scene, count: int, samples: int, stream: np.random.SeedSequence, camera_radius: float,
    field_of_view_deg: float, light_power_w: float, threads: int,
) -> tuple[dict[str, Array], dict[str, Any]]:  # fmt: skip
    """Render `count` views in each of `CONDITIONS`, in one process.

    A nearer lamp that no direction keeps off the surface is left out.

    Parameters
    ----------
    scene, samples, camera_radius, field_of_view_deg, light_power_w, threads
        As of held-out views of `views.simulate_views`.
    stream
        Of cameras, lamps, points looked at and paths.

    Returns
    -------
    arrays
        ``condition_rgba`` (c * count, `PART_PX`, `PART_PX`, 4) and how each was taken.
    attributes
        ``conditions``: by name what `Condition` says, and ``noise_floor_db``.
    """
    if not count:
        return {}, {}
    camera, light, look, path = (np.random.default_rng(child) for child in stream.spawn(4))
    cameras = look_at(uniform_on_sphere(count, camera_radius, camera)).reshape(-1, 4, 4)
    surface = Surface(scene.vertices, scene.faces)
    directions = [_direction(surface, pose, light) for pose in cameras]
    centres = [_covered_pixel(surface, pose, field_of_view_deg, look) for pose in cameras]
    names = [
        name
        for name in CONDITIONS
        if name != NEAR_CONDITION or not any(near is None for _, near in directions)
    ]
    away = np.array([anywhere if near is None else near for anywhere, near in directions])
    records, shots = [], []
    for name in names:
        condition = CONDITIONS[name]
        size, around = condition.resolution_px, condition.environment
        parts = np.array([_part(centre * size // RESOLUTION_PX, size) for centre in centres])
        lamps = condition.lamp_distance * away
        seeds = path.integers(0, 2**30, 2 * count, dtype=np.int32)
        least = max(1, int(PATH_SHARE * samples))
        records.append((parts, lamps))
        shots.append(Shots(
            np.tile(cameras, (2, 1, 1)), np.tile(lamps, (2, 1)), seeds, least, size, size, field_of_view_deg,
            light_power_w, threads=threads, environment=None if around is None else named_map(around),
            most_samples=None if scene.lets_through else MOST_PATH_TIMES * least,
            parts=np.tile(parts, (2, 1)),
        ))  # fmt: skip
    images, attributes = [], {}
    series = with_alpha_apart(scene, render_series(scene, shots), shots)
    for name, shot, rendered in zip(names, shots, series, strict=True):
        covered = with_cast_coverage(
            scene, rendered, shot.camera_to_world, shot.seeds, shot.field_of_view_deg
        )
        assert shot.parts is not None
        cut = np.array([
            image[top : top + height, left : left + width]
            for image, (top, left, height, width) in zip(covered, shot.parts, strict=True)
        ], dtype=np.float32)  # fmt: skip
        first, second = cut[:count], cut[count:]
        images.append(((first + second) / 2).astype(np.float16))
        attributes[name] = {**vars(CONDITIONS[name]), "noise_floor_db": _floor(first, second)}
    arrays = _arrays(
        np.concatenate(images), np.tile(cameras, (len(names), 1, 1)),
        *(np.concatenate(column) for column in zip(*records, strict=True)),
    )  # fmt: skip
    return arrays, {"conditions": attributes, "condition_noise_floor_definition": CONDITION_NOISE_FLOOR}


def _direction(
    surface: Surface, pose: np.ndarray, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return a direction on the camera's side, and one along which the near lamp is clear of the surface."""
    directions = uniform_on_sphere(LAMP_DIRECTIONS, 1.0, random)
    directions *= np.sign(directions @ pose[:3, 3])[:, None]
    lamps = CONDITIONS[NEAR_CONDITION].lamp_distance * directions
    # What a ray outwards does not meet is not around the lamp.
    clear = surface.ray_hits(lamps, directions).face < 0
    clear &= surface.closest_points(lamps).distance >= LAMP_CLEARANCE
    clear_lamps = np.flatnonzero(clear)
    return directions[0], directions[clear_lamps[0]] if len(clear_lamps) else None


def _covered_pixel(
    surface: Surface, pose: np.ndarray, field_of_view_deg: float, random: np.random.Generator
) -> np.ndarray:
    """Return (row, column) of a pixel of `RESOLUTION_PX` that shows the object; else the middle."""
    pixels, centre = np.arange(RESOLUTION_PX**2), np.array([[0.5, 0.5]])
    rays = pixel_rays(pose, pixels, centre, RESOLUTION_PX, field_of_view_deg)
    covered_pixels = np.flatnonzero(surface.ray_hits(*rays).face >= 0)
    pixel = (
        random.choice(covered_pixels) if len(covered_pixels) else (RESOLUTION_PX // 2) * (RESOLUTION_PX + 1)
    )
    return np.array(divmod(int(pixel), RESOLUTION_PX))


def _part(centre: np.ndarray, size: int) -> tuple[int, int, int, int]:
    """Return (top, left, height, width) of the part about a pixel, within an image of `size` pixels."""
    top, left = np.clip(centre - PART_PX // 2, 0, size - PART_PX)
    return int(top), int(left), PART_PX, PART_PX


def _floor(first: np.ndarray, second: np.ndarray) -> float | None:
    covered = (first[..., 3] + second[..., 3]) / 2 >= 0.5
    if not covered.any():
        return None
    error = ((composite_on_white(first) - composite_on_white(second))[covered] ** 2).mean() / 4
    return float(-10 * np.log10(max(float(error), 1e-12)))


def _arrays(rgba: np.ndarray, cameras: np.ndarray, parts: np.ndarray, lamps: np.ndarray) -> dict[str, Array]:
    view = "condition_view"
    names = "views in other conditions, in the order of the attribute `conditions`, as many of each"
    return {
        "condition_rgba": Array(
            rgba, (view, "part_y", "part_x", "channel"), "1", f"scene-linear premultiplied RGBA of {names}"
        ),
        "condition_camera_to_world": Array(cameras, (view, "row", "column"), "1", f"poses of {names}"),
        "condition_light_position": Array(
            lamps, (view, "axis"), "1", f"point lights, but in environments, of {names}"
        ),
        "condition_part": Array(
            parts.astype(np.int32), (view, "side"), "1", f"top, left, height and width, pixels, of {names}"
        ),
    }
