"""Images of what a surface of known material shows of itself in its gloss."""

import numpy as np

from objectfolder.vision.compiled.borders import beside, sum_by_pixel
from objectfolder.vision.compiled.effort import Effort
from objectfolder.vision.compiled.known_light import Gloss, KnownLight
from objectfolder.vision.compiled.network import Appearance
from objectfolder.vision.compiled.radiosity import Lights
from objectfolder.vision.compiled.shading import LIGHTS_IN_TURN, Chosen, Shading, cast_of
from objectfolder.vision.compiled.smoothing import SMOOTH_LOBE, make_smoother
from objectfolder.vision.compiled.visibility import View

# Points of a smooth piece of surface in a pixel whose gloss is asked whether it shows any surface, and how it
# looks. Where a piece ends these are all that are shaded: what gloss shows varies with the place.
GLOSS_PROBES, GLOSS_POINTS = 2, 12


def shade_gloss(
    shading: Shading,
    view: View,
    probes: Chosen,
    chosen: Chosen,
    appearance: Appearance,
    lights: Lights,
    effort: Effort,
) -> np.ndarray:
    """Return the colour (p, 3) of the surface that pixels show in their gloss, as `chosen`.

    Few rays tell in which pixels there is any. `Effort.gloss` says whether more are sent there and beside.
    """
    network, count = shading.network, len(view.rows)
    assert isinstance(network, KnownLight)
    if effort.gloss == 0 and network.wide:
        return np.zeros((count, 3))

    def gloss_of(pixels: np.ndarray, points: int, samples: tuple[int, int]) -> tuple[Chosen, Gloss]:
        row, part_of = chosen.thinned(points, pixels)
        of_row = appearance[0][row], appearance[1][row]
        directions = np.where(part_of.pixel < view.samples[1].start, *samples)
        return part_of, (part_of.points, of_row, cast_of(view, part_of), directions)

    def summed(part_of: Chosen, part: np.ndarray) -> np.ndarray:
        total: np.ndarray = sum_by_pixel(part_of.pixel, part_of.weight, part, count)
        return total

    few, gloss = gloss_of(np.ones(count, dtype=bool), GLOSS_PROBES, (1, 1))
    shown = network.shown(*gloss, 1)
    smooth, width = make_smoother(view, probes), SMOOTH_LOBE * float(network.alpha2)
    if effort.gloss < 2:
        sent = shown.sent(network.radiance_of(shown, lights, 1, coarse=effort.coarse))
        return smooth(width, summed(few, sent), summed(few, shown.everything))
    shows = np.zeros(count, dtype=bool)
    shows[few.pixel[shown.row]] = True
    shows = beside(view.edges, beside(view.edges, shows))
    many, gloss = gloss_of(shows, GLOSS_POINTS, network.samples)
    turns = network.samples[0] if len(lights[0]) >= LIGHTS_IN_TURN else 1
    above, below = (summed(many, part) for part in network.in_gloss(*gloss, lights, turns))
    below[~shows] = summed(few, shown.everything)[~shows]
    return smooth(width, above, below)
