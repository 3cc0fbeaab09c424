"""Images in an environment."""

from dataclasses import replace

import numpy as np

from objectfolder.vision.compiled.borders import contrasting, sum_by_pixel
from objectfolder.vision.compiled.effort import Effort
from objectfolder.vision.compiled.grouping import GROUPS
from objectfolder.vision.compiled.known_light import KnownLight
from objectfolder.vision.compiled.shading import MOST_SHADED, SHOWN, Chosen, Shading, cast_of, labels_of
from objectfolder.vision.compiled.smoothing import SMOOTH_LOBE, make_smoother, smooth_gathered
from objectfolder.vision.compiled.surroundings import Surroundings
from objectfolder.vision.compiled.visibility import View
from objectfolder.vision.compositing import srgb_encode

# Of known material, where a piece of surface ends and colour changes: times more points, if `MOST_SHADED`
# allows.
ENDS = 4
# Where a piece ends, pixels are not averaged with others, and maps are looked up this much more sparsely.
AVERAGED = 16
# Directions of a highlight in an environment for a point of an even pixel (else 1), learned and of known
# material, and of one mirrored.
HIGHLIGHT_SAMPLES, KNOWN_SAMPLES, MIRROR_SAMPLES = 2, 8, 4


def shade_surrounded(shading: Shading, view: View, around: Surroundings, effort: Effort) -> np.ndarray:
    """Return pi times the colour (p, 3) of the pixels in an environment."""
    labels, alpha2 = labels_of(view), shading.network.alpha2
    is_known = isinstance(shading.network, KnownLight)
    probes = shading.chosen(view, labels, np.ones(len(view.rows), dtype=np.int64))
    gathered = around.gathered(probes.points, cast_of(view, probes))
    smooth = make_smoother(view, probes)
    gathered = smooth_gathered(probes, gathered, smooth)
    mirrored = around.in_mirrors(probes.points, cast_of(view, probes), MIRROR_SAMPLES)
    probe = np.zeros((len(view.rows), GROUPS), dtype=np.int64)
    probe[probes.pixel, probes.group] = np.arange(len(probes.pixel))

    def summed(chosen: Chosen, colour: np.ndarray) -> np.ndarray:
        total: np.ndarray = sum_by_pixel(chosen.pixel, chosen.weight, colour, len(view.rows))
        return total

    def shaded(samples_per_group: np.ndarray, samples: int) -> np.ndarray:
        chosen = shading.chosen(view, labels, samples_per_group)
        of = probe[chosen.pixel, chosen.group]
        cast = cast_of(view, chosen)
        if is_known:
            alone = chosen.pixel >= view.samples[1].start
            cast = replace(cast, count=np.where(alone, cast.count / AVERAGED, cast.count))
        matt, *gloss = around.shown(chosen.points, gathered.of(of), cast, samples, alpha2)
        return np.stack([summed(chosen, part) for part in (matt + mirrored[of], *gloss)])

    most, finest = np.full(len(view.rows), effort.shaded), np.full(len(view.rows), effort.shaded_uneven)
    if is_known and effort.shaded_ends:
        # Where a piece ends nothing is averaged over pixels.
        ends = view.samples[1].pixels
        most[ends] = effort.shaded_ends
        finest[ends] = min(ENDS * effort.shaded_uneven, MOST_SHADED)
    chosen = shading.chosen(view, labels, np.full(len(view.rows), effort.shaded))
    outline = around.outlined(chosen.points, gathered.of(probe[chosen.pixel, chosen.group]))
    matt, even = (summed(chosen, part) for part in outline)
    shade = srgb_encode(SHOWN * (matt + even) / view.coverage[:, None])
    uneven = contrasting(view.edges, shade, effort.contrast)
    coarse = shaded(np.where(uneven, 0, most), KNOWN_SAMPLES if is_known else HIGHLIGHT_SAMPLES)
    fine = shaded(np.where(uneven, finest, 0), 1)
    matt, gloss, even = coarse + fine
    return matt + smooth(SMOOTH_LOBE * float(alpha2), gloss, even)
