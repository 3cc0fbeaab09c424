"""Environments: light from all round, infinitely far, as maps of radiance in the object's frame.

A map is equirectangular and linear, (h, 2 h, 3), oriented as in Blender: row 0 looks along +z of the object's
frame, the middle of the image along +x, a quarter to the left of it along +y. Image and map are in one unit
of radiance: inside a white furnace, radiance 1 everywhere, a white matt plane shows 1.
"""

import heapq
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.query_values import real_array

ENVIRONMENTS = ("studio", "sky", "window")
NAMED_ROWS = 128
MOST_ROWS = 2048
# Lights that a map is cut into, and rows of the map from which they and the irradiance are summed at most.
MAP_LIGHTS, LIGHT_ROWS, IRRADIANCE_ROWS, EVEN_SHARE = 256, 256, 32, 0.5
# Weights of red, green and blue in luminance (ITU-R BT.709).
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
# (top, bottom, left, right) of a part of a map, pixels.
Part = tuple[int, int, int, int]


@dataclass(frozen=True)
class Environment:
    """A map, and what is summed over it beforehand.

    Parameters
    ----------
    texels, heights
        (t, 3) float32 radiance of a pyramid of maps, the finest first, and the rows (l,) of each.
    irradiance
        (h, 2 h, 3) float32 irradiance of a plane whose normal is the pixel's direction, nothing in the way.
    directions, powers
        (`MAP_LIGHTS`, 3) float64: lights that stand for parts of much the same power, neighbours in turn, and
        radiance times solid angle of each.
    """

    texels: np.ndarray
    heights: np.ndarray
    irradiance: np.ndarray
    directions: np.ndarray
    powers: np.ndarray

    @classmethod
    def of(cls, light: Any) -> "Environment":
        """Return the environment of a name or of a map (h, 2 h, 3); an environment as it is.

        Raises
        ------
        QueryError
            Another name or shape; values that are negative or not finite.
        """
        if isinstance(light, Environment):
            return light
        return _named(light) if isinstance(light, str) else _prepared(_checked(light))


def _checked(light: Any) -> np.ndarray:
    remedy = (
        f"Name one of {', '.join(ENVIRONMENTS)}, or give (h, 2 h, 3) linear radiance, h up to {MOST_ROWS}."
    )
    radiance = real_array("lights", light, remedy)
    height = radiance.shape[0] if radiance.ndim else 0
    if not 0 < height <= MOST_ROWS or radiance.shape != (height, 2 * height, 3):
        raise QueryError("lights", f"shape {radiance.shape}", remedy)
    if not (radiance >= 0).all() or radiance.max() > np.finfo(np.float32).max / 1e6:
        raise QueryError("lights", "values that are negative or not finite", "Give radiance.")
    return radiance


@cache
def _named(name: str) -> Environment:
    if name not in ENVIRONMENTS:
        raise QueryError(
            "lights", f"{name!r} is none that is known", f"Use {', '.join(ENVIRONMENTS)}, or a map."
        )
    return _prepared(named_map(name))


def named_map(name: str) -> np.ndarray:
    """Return the map (h, 2 h, 3) of one of `ENVIRONMENTS`, float64.

    The studio has three bright panels and a grey room, the sky a sun of 5 degrees radius above a ground, the
    window four panes in a dim room.
    """
    directions, _ = pixel_directions(NAMED_ROWS)
    up = directions[..., 2:]
    if name == "sky":
        haze = (1 - np.clip(up, 0, 1)) ** 3
        above = haze * [0.75, 0.8, 0.9] + (1 - haze) * [0.25, 0.42, 0.8]
        off = 1 - directions @ _towards(-70, 50)
        sun = 60 * _inside(1 - np.cos(np.deg2rad(5)) - off, 6e-4) + 1.5 * np.exp(-off / 0.03)
        return np.where(up > 0, above, [0.22, 0.2, 0.17]) + sun[..., None] * [1.0, 0.93, 0.8]
    if name == "window":
        x, y, panes = _panel(directions, -40, 25, 1.2, 1.0, 0.01)
        panes = panes * _inside(np.abs(x) - 0.04, 0.01) * _inside(np.abs(y) - 0.04, 0.01)
        return 0.06 + 0.05 * (up + 1) * [1, 0.95, 0.9] + 12 * panes[..., None] * [0.85, 0.93, 1]
    key, fill, rim = (
        _panel(directions, *panel, 0.02)[2][..., None]
        for panel in ((-110, 45, 0.9, 0.9), (0, 20, 0.8, 1.2), (120, 50, 1.2, 0.5))
    )
    return 0.12 + 0.12 * (up + 1) + 9 * key * [1, 0.97, 0.92] + 3 * fill * [0.92, 0.96, 1] + 5 * rim


def _towards(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    azimuth, elevation = np.deg2rad([azimuth_deg, elevation_deg])
    level = np.cos(elevation)
    return np.array([np.cos(azimuth) * level, np.sin(azimuth) * level, np.sin(elevation)])


def _inside(distance: np.ndarray, edge: float) -> np.ndarray:
    """Return 1 inside and 0 outside of a soft edge."""
    result: np.ndarray = 0.5 + 0.5 * np.tanh(distance / (2 * edge))
    return result


def _panel(
    directions: np.ndarray, azimuth_deg: float, elevation_deg: float, wide: float, tall: float, edge: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and share of a panel at distance 1 that faces the origin."""
    axis, right = _towards(azimuth_deg, elevation_deg), _towards(azimuth_deg + 90, 0)
    ahead = directions @ axis
    x, y = (directions @ side / np.maximum(ahead, 1e-6) for side in (right, np.cross(axis, right)))
    share = _inside(wide / 2 - np.abs(x), edge) * _inside(tall / 2 - np.abs(y), edge)
    return x, y, np.where(ahead > 0, share, 0.0)


def _prepared(radiance: np.ndarray) -> Environment:
    directions, solid_angle = pixel_directions(len(radiance))
    power = radiance * solid_angle[:, None, None]
    moment = directions * (power @ LUMINANCE)[..., None]
    levels, powers, moments = [radiance], [power], [moment]
    while len(power) > 1:
        power, moment = _halved(power), _halved(moment)
        powers.append(power)
        moments.append(moment)
        levels.append(power / pixel_directions(len(power))[1][:, None, None])
    heights = np.array([len(level) for level in levels])
    of_parts = _lights(powers[int(np.argmax(heights <= LIGHT_ROWS))])
    coarse = int(np.argmax(heights <= IRRADIANCE_ROWS))
    along = moments[coarse].reshape(-1, 3)
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    normals = pixel_directions(IRRADIANCE_ROWS)[0]
    irradiance = np.maximum(normals @ along.T, 0) @ powers[coarse].reshape(-1, 3)
    texels = np.concatenate([level.reshape(-1, 3) for level in levels]).astype(np.float32)
    return Environment(texels, heights, irradiance.astype(np.float32), *of_parts)


def _halved(power: np.ndarray) -> np.ndarray:
    """Return sums of a map over the pixels of one of half the rows."""
    height = len(power) // 2
    rows, columns = (np.arange(size) * len(power) // height for size in (height, 2 * height))
    return np.add.reduceat(np.add.reduceat(power, rows, axis=0), columns, axis=1)


def _lights(power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `MAP_LIGHTS` directions and powers (n, 3); of fewer parts some are in shares."""
    (directions, solid_angle), luminous = pixel_directions(len(power)), power @ LUMINANCE
    # Where the map is dim there are lights as well: a side that faces away from its lamps is lit by that.
    even = EVEN_SHARE * luminous.sum() / (4 * np.pi) * solid_angle[:, None]
    parts = _median_cut(luminous + even)
    along, sums = np.zeros((max(1, len(parts)), 3)), np.zeros((max(1, len(parts)), 3))
    for index, (top, bottom, left, right) in enumerate(parts):
        part = np.s_[top:bottom, left:right]
        along[index] = np.einsum("ij,ijk->k", luminous[part], directions[part])
        sums[index] = power[part].sum(axis=(0, 1))
    # Opposite directions may cancel, in a part that spans the whole map.
    length = np.linalg.norm(along, axis=1, keepdims=True)
    has_direction = length[:, 0] > 1e-9 * (sums @ LUMINANCE)
    along = np.where(has_direction[:, None], along / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0])
    which = np.arange(MAP_LIGHTS) * len(along) // MAP_LIGHTS
    return along[which], sums[which] / np.bincount(which)[which, None]


def pixel_directions(height: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (h, 2 h, 3) unit directions of an equirectangular map's pixels and the solid angle (h,) of each.

    The solid angles, in steradians, are exact and add up to 4 pi.
    """
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    polar = np.pi * (np.arange(height) + 0.5)[:, None] / height
    azimuth = np.pi - np.pi * (np.arange(2 * height) + 0.5) / height
    upright = np.broadcast_to(np.cos(polar), (height, 2 * height))
    directions = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), upright]
    return np.stack(directions, axis=-1), (edges[:-1] - edges[1:]) * (np.pi / height)


def _median_cut(luminous: np.ndarray) -> list[Part]:
    """Cut a map of power into at most `MAP_LIGHTS` parts of much the same power (Debevec 2005).

    Each cut is across the longer side. The parts come in the order of the tree of cuts, so that those that
    follow one another lie side by side.
    """
    height, width = luminous.shape
    # Sums of all above and to the left: the power of a part is four look-ups.
    sums = np.zeros((height + 1, width + 1))
    sums[1:, 1:] = luminous.cumsum(axis=0).cumsum(axis=1)
    pending: list[tuple[float, str, Part]] = []
    leaves: list[tuple[str, Part]] = []

    def put(path: str, part: Part) -> None:
        top, bottom, left, right = part
        if luminous[top:bottom, left:right].any():
            power = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
            heapq.heappush(pending, (-float(power), path, part))

    put("", (0, height, 0, width))
    while pending and len(pending) + len(leaves) < MAP_LIGHTS:
        _, path, (top, bottom, left, right) = heapq.heappop(pending)
        middle = np.pi * (top + bottom) / (2 * height)
        tall, wide = np.pi * (bottom - top) / height, 2 * np.pi * (right - left) / width * np.sin(middle)
        if bottom - top == 1 and right - left == 1:
            leaves.append((path, (top, bottom, left, right)))
        elif right - left == 1 or (tall >= wide and bottom - top > 1):
            cut = top + _half(sums[top : bottom + 1, right] - sums[top : bottom + 1, left])
            put(path + "0", (top, cut, left, right))
            put(path + "1", (cut, bottom, left, right))
        else:
            cut = left + _half(sums[bottom, left : right + 1] - sums[top, left : right + 1])
            put(path + "0", (top, bottom, left, cut))
            put(path + "1", (top, bottom, cut, right))
    return [part for _, part in sorted([*leaves, *((path, part) for _, path, part in pending)])]


def _half(sums: np.ndarray) -> int:
    """Return where to cut (n + 1,) running sums so that both sides have n > 0 and much the same."""
    middle = (sums[0] + sums[-1]) / 2
    return int(np.clip(np.argmin(np.abs(sums - middle)), 1, len(sums) - 2))
