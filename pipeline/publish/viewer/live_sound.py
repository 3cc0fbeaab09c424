"""How loud a sound in metres a second is played."""

import numpy as np

from objectfolder.object_file import ObjectFile

USUAL_IMPULSE_N_S = 0.05
PEAK_OF_FULL_SCALE = 0.33


def listening_gain(file: ObjectFile) -> float:
    """Return the factor at which a usual blow at a typical place peaks at a third of full scale.

    One factor an object: a harder blow is louder, as it is.
    """
    points, normals = file.sample_contacts(9, seed=0)
    if not len(file.modes.eigenvalues):
        return 1.0
    sounds = file.strike(points, -USUAL_IMPULSE_N_S * normals, duration=0.05)
    peak = float(np.median(np.abs(sounds).max(axis=1)))
    return PEAK_OF_FULL_SCALE / peak if peak > 0 else 1.0
