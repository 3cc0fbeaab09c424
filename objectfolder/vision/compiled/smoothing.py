"""Averages over the pixels that see one smooth piece of surface."""

from collections.abc import Callable

import numpy as np

from objectfolder.vision.compiled.borders import smoothed
from objectfolder.vision.compiled.shading import Chosen
from objectfolder.vision.compiled.surroundings import Gathered
from objectfolder.vision.compiled.visibility import View

# Averages, where normals turn by less than so much, a quantity (p, 3) of pixels as a multiple of another.
Smoother = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
# What arrives from all round is averaged over pixels this far to either side. Of weight 1 / e are those whose
# normals turn by so much (1 - cosine; the highlight's: times its squared width), or so far off the plane.
SMOOTH_PX, SMOOTH_TURN, SMOOTH_LOBE, SMOOTH_OFF = 1, 0.05, 0.1, 0.01


def make_smoother(view: View, probes: Chosen) -> Smoother:
    """Return a function that averages over the pixels that see one smooth piece, of one probe each.

    It takes how far normals may turn, and a quantity (p, 3) of the pixels that is averaged as a multiple of
    another.
    """
    first = np.searchsorted(probes.pixel, np.arange(len(view.rows)))
    single = np.bincount(probes.pixel, minlength=len(view.rows)) == 1
    position, normal = probes.points.position[first], probes.points.normal[first] * single[:, None]

    def smooth(turn: float, above: np.ndarray, below: np.ndarray) -> np.ndarray:
        ratio = smoothed(view.slots, SMOOTH_PX, position, normal, turn, SMOOTH_OFF, above, below)
        return np.where(single[:, None] & (below > 0), ratio * below, above)

    return smooth


def smooth_gathered(probes: Chosen, gathered: Gathered, smooth: Smoother) -> Gathered:
    """Return what was gathered, smooth in pixels of one probe."""
    first = np.flatnonzero(np.diff(probes.pixel, prepend=-1))
    single = np.diff(first, append=len(probes.pixel)) == 1
    plain = Gathered(gathered.arriving.copy(), gathered.unhindered, gathered.bounced.copy())
    alone = first[single]
    plain.arriving[alone] = smooth(SMOOTH_TURN, gathered.arriving[first], gathered.unhindered[first])[single]
    plain.bounced[alone] = smooth(SMOOTH_TURN, gathered.bounced[first], np.ones((len(first), 3)))[single]
    return plain
