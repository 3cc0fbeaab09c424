"""Environment maps as point lights: what surrounds an object, gathered into a few lights.

A point light of power P sends the irradiance P cos / (4 pi d^2), so that in the data set's units a light of
colour c shows on a Lambertian surface the radiance albedo * s c cos / d^2 with s = P / (4 pi^2). The part of
an environment of radiance L that fills a solid angle w has the irradiance L w cos, which shows
albedo * L w cos / pi. Both agree at the origin for a light at distance R of colour

    c = L w R^2 / (pi s).

So image and environment are in one unit of radiance, whatever it is: a white Lambertian plane inside a white
furnace, an environment of radiance L everywhere, has the irradiance pi L and shows L.

At a place r from the origin a light at R stands elsewhere than the environment that it is for: its
direction is off by up to asin(r / R), and its irradiance is (R / d)^2 of the true one, between (1 + r/R)^-2
and (1 - r/R)^-2. For an even environment the errors of near and far lights all but cancel: the irradiance
is too high by at most (1 - (r/R)^2)^-1/2 - 1; at R = 2 that is 3 % half a unit from the centre and 11 % in
the corners of the unit cube. For uneven ones parallax is what counts: half a unit from the centre, facing
outwards, the irradiance under a bright sky and under a sky with a sun is off by 9 % and 19 % of its mean at
R = 2, by half of that at R = 4, while 64 lights at infinity would be within 1 %. A larger radius makes
these errors smaller and takes the lights farther from those that a VisionNet was trained on (radius 1),
which the light bounced between surfaces is sensitive to.
"""

import heapq

import numpy as np

from objectfolder.errors import QueryError

RADIUS = 2.0
# Weights of red, green and blue in luminance (ITU-R BT.709).
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def environment_lights(
    radiance: np.ndarray,
    count: int,
    *,
    radiance_scale: float,
    radius: float = RADIUS,
    seed: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Turn an environment map into point lights by median cut (Debevec 2005).

    The map is cut `count` - 1 times, each time the part of most power in two of equal power, across its
    longer side. A part becomes one light.

    Parameters
    ----------
    radiance
        (h, w, 3) scene-linear radiance, not negative, in equirectangular projection as in Blender: row 0
        looks along +z of the object's frame, the middle of the image along +x, a quarter to the left of it
        along +y.
    count
        Lights at most; fewer where the map has fewer bright pixels.
    radiance_scale
        s = P / (4 pi^2) of the VisionNet, `VisionNet.radiance_scale`.
    radius
        Distance R of the lights from the origin, unit frame; more than 0.9, which encloses the unit cube.
    seed
        Put a light at a pixel drawn in proportion to its luminance, which makes the mean over seeds exact
        for any integral over the lights, not in the direction in which most of its part's power lies.

    Returns
    -------
    positions
        (k, 3) float64, unit frame.
    colours
        (k, 3) float64 factors of the data set's light, for `light_colour`.

    Raises
    ------
    QueryError
        A map of another shape, of values that are negative or not finite; no lights; a radius too small.
    """
    pixels = np.asarray(radiance, dtype=np.float64)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        raise QueryError("environment", f"shape {pixels.shape}", "Give (height, width, 3) linear radiance.")
    if not np.isfinite(pixels).all() or pixels.min() < 0:
        raise QueryError("environment", "values that are negative or not finite", "Give radiance.")
    if count < 1:
        raise QueryError("lights of the environment", f"{count}", "Ask for at least one.")
    if not radius > 0.9:
        raise QueryError(
            "radius", f"{radius} in the unit frame", "Put the lights outside the object: above 0.9."
        )
    directions, solid_angle = pixel_directions(*pixels.shape[:2])
    power = pixels * solid_angle[:, None, None]
    luminous = power @ LUMINANCE
    if not luminous.any():
        return np.zeros((0, 3)), np.zeros((0, 3))
    random = None if seed is None else np.random.default_rng(seed)
    places, sums = [], []
    for rows, columns in _median_cut(luminous, count):
        part, weight = power[rows, columns].reshape(-1, 3), luminous[rows, columns].ravel()
        along = directions[rows, columns].reshape(-1, 3)
        if random is None:
            mean = weight @ along
            # Opposite directions may cancel, in a part that spans the whole map.
            length = np.linalg.norm(mean)
            places.append(mean / length if length > 1e-9 * weight.sum() else along[np.argmax(weight)])
            sums.append(part.sum(axis=0))
        else:
            drawn = random.choice(len(weight), p=weight / weight.sum())
            places.append(along[drawn])
            sums.append(part[drawn] * (weight.sum() / weight[drawn]))
    return radius * np.array(places), np.array(sums) * (radius**2 / (np.pi * radiance_scale))


def pixel_directions(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (h, w, 3) unit directions of an equirectangular map's pixels and the solid angle (h,) of each.

    The solid angles, in steradians, are exact and add up to 4 pi.
    """
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    polar = np.pi * (np.arange(height) + 0.5) / height
    azimuth = np.pi - 2 * np.pi * (np.arange(width) + 0.5) / width
    ring = np.sin(polar)[:, None]
    directions = np.stack(
        [
            ring * np.cos(azimuth),
            ring * np.sin(azimuth),
            np.broadcast_to(np.cos(polar)[:, None], (height, width)),
        ],
        axis=-1,
    )
    return directions, (edges[:-1] - edges[1:]) * (2 * np.pi / width)


def _median_cut(luminous: np.ndarray, count: int) -> list[tuple[slice, slice]]:
    """Cut a map of power into at most `count` parts of much the same power, each with some."""
    height, width = luminous.shape
    # Sums of all above and to the left: the power of a part is four look-ups.
    sums = np.zeros((height + 1, width + 1))
    sums[1:, 1:] = luminous.cumsum(axis=0).cumsum(axis=1)

    def power(top: int, bottom: int, left: int, right: int) -> float:
        return float(sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left])

    # Of equal power the part that came first, so that equal maps are cut alike.
    parts = [(-power(0, height, 0, width), 0, (0, height, 0, width))]
    made = 0
    done: list[tuple[int, int, int, int]] = []
    while parts and len(parts) + len(done) < count:
        _, _, (top, bottom, left, right) = heapq.heappop(parts)
        middle = np.pi * (top + bottom) / (2 * height)
        tall, wide = np.pi * (bottom - top) / height, 2 * np.pi * (right - left) / width * np.sin(middle)
        if bottom - top == 1 and right - left == 1:
            done.append((top, bottom, left, right))
            continue
        if right - left == 1 or (tall >= wide and bottom - top > 1):
            along = sums[top : bottom + 1, right] - sums[top : bottom + 1, left]
            cut = top + _half(along)
            halves = [(top, cut, left, right), (cut, bottom, left, right)]
        else:
            along = sums[bottom, left : right + 1] - sums[top, left : right + 1]
            cut = left + _half(along)
            halves = [(top, bottom, left, cut), (top, bottom, cut, right)]
        for half in halves:
            if luminous[half[0] : half[1], half[2] : half[3]].any():
                made += 1
                heapq.heappush(parts, (-power(*half), made, half))
    everything = [*done, *(part for _, _, part in sorted(parts, key=lambda part: part[1]))]
    return [(slice(top, bottom), slice(left, right)) for top, bottom, left, right in everything]


def _half(sums: np.ndarray) -> int:
    """Return where to cut (n + 1,) running sums so that both sides have n > 0 and much the same."""
    middle = (sums[0] + sums[-1]) / 2
    return int(np.clip(np.argmin(np.abs(sums - middle)), 1, len(sums) - 2))
