"""Images under lamps: shadows that end within pixels, and many lamps in turn."""

from dataclasses import replace

import numpy as np

from objectfolder.vision.compiled.borders import contrasting, mixed, sum_by_pixel
from objectfolder.vision.compiled.effort import Effort
from objectfolder.vision.compiled.grouping import GROUPS, samples_to_ask, split_groups
from objectfolder.vision.compiled.known_light import KnownLight
from objectfolder.vision.compiled.shading import SHOWN, Chosen, Shading, VisiblePoints, join_lights, labels_of
from objectfolder.vision.compiled.visibility import View
from objectfolder.vision.compositing import srgb_encode

# Points of a piece of surface in a pixel, at each of which another one of many lamps is asked, at most.
MOST_TURNS = 16
# At `MORE` points where normals turn in a pixel: 1 - length of their mean, in squared widths of the lobe.
CURVED, MORE = 0.03, 4
# The same, and the difference to a neighbour in sRGB, from which on `Effort.shaded_uneven` points meet a
# highlight by chance.
TURNED, SHARP = 0.7, 0.2


def shade_lit(
    shading: Shading, view: View, probes: Chosen, chosen: Chosen, visible: VisiblePoints, light: np.ndarray,
    effort: Effort, curved: np.ndarray | None,
) -> np.ndarray:  # fmt: skip
    """Return the colour (p, 3) of the pixels under one light of colour 1.

    `chosen` and what is `visible` there serve each light, but for pixels in which its shadow ends, and
    in which colour changes fast: the more so in those that are `curved` (p,), if `Effort` asks for it.
    """
    labels, state, split = _find_shadows(shading, view, probes, light, effort.shadow_rays)
    coarse, finest = np.full(len(split), effort.shaded), np.full(len(split), effort.shaded_uneven)
    several = isinstance(shading.network, KnownLight) and effort.shaded_ends > 0
    if several:
        uneven = view.samples[1]
        labels[1], state[uneven.pixels], split[uneven.pixels] = uneven.label, 0, False
        coarse[uneven.pixels] = 2 * effort.shaded_ends
        finest = np.maximum(finest, coarse)

    def again(pixels: np.ndarray, most: np.ndarray) -> None:
        more = shading.chosen(view, labels, np.where(pixels, most, 0))
        visible = shading.visible(more.points)
        colour[pixels] = _shade(shading, more, visible, state, light, effort.coarse)[0][pixels]

    colour, answer = _shade(shading, chosen, visible, state, light, effort.coarse)
    if several:
        ends = mixed(view.edges, len(split), chosen.pixel, answer)
        split[uneven.pixels] = ends[uneven.pixels]
    if not effort.coarse:
        again(split, coarse)
    if effort.shaded_uneven > effort.shaded:
        shade = srgb_encode((SHOWN * colour / view.coverage[:, None]).astype(np.float32))
        if curved is not None:
            sharp = curved & contrasting(view.edges, shade, SHARP)
            finest[sharp] = np.maximum(finest[sharp], effort.shaded_curved)
        contrast = contrasting(view.edges, shade, effort.contrast)
        again(contrast | split if effort.coarse else contrast, finest)
    return colour


def mark_curved(shading: Shading, chosen: Chosen, count: int) -> np.ndarray:
    """Return in which (count,) pixels a smooth piece of surface turns by much of a highlight's width."""
    first = np.flatnonzero(np.diff(chosen.pixel * GROUPS + chosen.group, prepend=-1))
    mean = np.add.reduceat(chosen.weight[:, None] * chosen.points.normal, first)
    mean /= np.add.reduceat(chosen.weight, first)[:, None]
    turned = 1 - np.linalg.norm(mean, axis=1) > TURNED * shading.network.alpha2
    curved = np.zeros(count, dtype=bool)
    curved[chosen.pixel[first[turned]]] = True
    return curved


def _find_shadows(
    shading: Shading, view: View, probes: Chosen, light: np.ndarray, rays: int
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Ask one point a group, and `rays` sub-samples of a pixel where a shadow ends.

    Returns
    -------
    labels
        Groups of `view.samples`, of which those in shadow are numbered from `GROUPS` where one ends.
    state
        (p, 2 * GROUPS) 1 lit, 2 in shadow, 0 not asked.
    split
        (p,) whether a shadow ends in the pixel.
    """
    irradiance, hidden = shading.surface.light_from(probes.points, light)
    answer = np.where(irradiance > 0, 1 + hidden, 0)
    state = np.zeros((len(view.rows), 2 * GROUPS), dtype=np.int64)
    state[probes.pixel, probes.group] = answer
    split = mixed(view.edges, len(view.rows), probes.pixel, answer)
    state[split, :GROUPS], state[split, GROUPS:] = 1, 2
    labels = []
    for samples in view.samples:
        label = samples.label.copy()
        inside = np.flatnonzero(split[samples.pixels])
        pixel, sample = samples_to_ask(label, inside, rays, GROUPS)
        points = shading.points(view, *view.places(samples, pixel, sample))
        _, hidden = shading.surface.light_from(points, light)
        split_groups(label, pixel, sample, hidden, samples.offsets[0], samples.offsets[1], GROUPS)
        labels.append(label)
    return labels, state, split


def _shade(
    shading: Shading, chosen: Chosen, visible: VisiblePoints, state: np.ndarray, light: np.ndarray,
    coarse: bool,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the colour (p, 3) of the pixels from points that were chosen, and these points' states."""
    state_of = state[chosen.pixel, chosen.group]
    irradiance, hidden = shading.surface.light_from(chosen.points, light, state_of == 0)
    answer = np.where(irradiance > 0, np.where(hidden | (state_of == 2), 2, 1), 0)
    irradiance[answer == 2] = 0.0
    colour = shading.colour(visible, irradiance, light, coarse=coarse)
    return sum_by_pixel(chosen.pixel, chosen.weight, colour, len(state)), answer


def shade_in_turn(
    shading: Shading, view: View, lights: list[tuple[np.ndarray, np.ndarray]], effort: Effort
) -> np.ndarray:
    """Return the colour (p, 3) of the pixels under many lights, each asked at one point of a group.

    The next light is asked at the next point: a group's points are found once, and are all asked
    (interleaved sampling, Keller and Heidrich 2001).
    """
    count, turns = len(view.rows), min(effort.shaded_uneven, MOST_TURNS)
    chosen = shading.chosen(view, labels_of(view), np.full(count, turns))
    visible = shading.visible(chosen.points)
    first = np.flatnonzero(np.diff(chosen.pixel * GROUPS + chosen.group, prepend=-1))
    several = np.diff(first, append=len(chosen.pixel))
    share = np.add.reduceat(chosen.weight, first)

    def mean(values: np.ndarray) -> np.ndarray:
        total: np.ndarray = np.add.reduceat(chosen.weight[:, None] * values, first)
        return total / share[:, None]

    # What varies most inside a pixel is its texture, and no light changes that.
    albedo = mean(visible.appearance[1]).astype(np.float32)
    visible = replace(visible, appearance=(visible.appearance[0], np.repeat(albedo, several, axis=0)))
    turned = 1 - np.linalg.norm(mean(chosen.points.normal), axis=1)
    asks = np.where(turned > CURVED * shading.network.alpha2, np.minimum(MORE, several), 1)
    group = np.repeat(np.arange(len(first)), asks)
    # Bounced light varies little inside a pixel.
    lead = np.cumsum(asks) - asks
    order = np.arange(len(group)) - lead[group]
    pixel, weight = chosen.pixel[first[group]], (share / asks)[group]
    start = 5 * view.columns[pixel].astype(np.int64) + 3 * view.rows[pixel].astype(np.int64)
    start += order * several[group] // asks[group]
    colour = np.zeros((count, 3))
    for turn in range(turns):
        queried = visible.of(first[group] + (start + turn) % several[group])
        once = None if isinstance(shading.network, KnownLight) else queried.of(lead)
        for light, factor in lights[turn::turns]:
            irradiance = shading.arriving(queried.points, light)
            direct = shading.directly(queried, irradiance, light)
            colour += factor * sum_by_pixel(pixel, weight, direct, count)
            if once is not None and not isinstance(shading.network, KnownLight):
                bounced = shading.network.bounced_by(once.points, once.appearance, irradiance[lead], light)
                colour += factor * sum_by_pixel(pixel[lead], share, bounced, count)
    if isinstance(shading.network, KnownLight):
        alone = visible.of(first)
        bounced = shading.network.bounced(
            alone.points, alone.appearance, join_lights(lights), coarse=effort.coarse
        )
        colour += sum_by_pixel(chosen.pixel[first], share, bounced, count)
    return colour
