"""Images in an environment."""

import numpy as np

from objectfolder.vision.compiled.borders import contrasting, sum_by_pixel
from objectfolder.vision.compiled.effort import Effort
from objectfolder.vision.compiled.grouping import GROUPS
from objectfolder.vision.compiled.shading import SHOWN, Chosen, Shading, cast_of, labels_of
from objectfolder.vision.compiled.smoothing import SMOOTH_LOBE, make_smoother, smooth_gathered
from objectfolder.vision.compiled.surroundings import Surroundings
from objectfolder.vision.compiled.visibility import View
from objectfolder.vision.compositing import srgb_encode

# Directions of a highlight in an environment for a point of an even pixel (else 1), and of one mirrored.
HIGHLIGHT_SAMPLES, MIRROR_SAMPLES = 2, 4


def shade_surrounded(shading: Shading, view: View, around: Surroundings, effort: Effort) -> np.ndarray:
    """Return pi times the colour (p, 3) of the pixels in an environment."""
    labels, alpha2 = labels_of(view), shading.network.alpha2
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

    def shaded(wanted: np.ndarray, samples: int) -> np.ndarray:
        chosen = shading.chosen(view, labels, wanted)
        of = probe[chosen.pixel, chosen.group]
        matt, *gloss = around.shown(chosen.points, gathered.of(of), cast_of(view, chosen), samples, alpha2)
        return np.stack([summed(chosen, part) for part in (matt + mirrored[of], *gloss)])

    chosen = shading.chosen(view, labels, np.full(len(view.rows), effort.shaded))
    outline = around.outlined(chosen.points, gathered.of(probe[chosen.pixel, chosen.group]))
    matt, even = (summed(chosen, part) for part in outline)
    shade = srgb_encode(SHOWN * (matt + even) / view.coverage[:, None])
    uneven = contrasting(view.edges, shade, effort.contrast)
    coarse = shaded(np.where(uneven, 0, effort.shaded), HIGHLIGHT_SAMPLES)
    fine = shaded(np.where(uneven, effort.shaded_uneven, 0), 1)
    matt, gloss, even = coarse + fine
    return matt + smooth(SMOOTH_LOBE * float(alpha2), gloss, even)
