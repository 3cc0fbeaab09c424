"""What a sensor shows untouched in the light of a session's photographs, which show it touched."""

from collections.abc import Sequence

import numpy as np

from objectfolder.touch.sensor.ball_prints import Print

# Of the contact's radius: what lies farther from every mark is untouched gel.
UNTOUCHED = 2.2
LEAST_PRINTS = 3


def session_light(
    photographs: np.ndarray, untouched: np.ndarray, prints: Sequence[Print | str]
) -> np.ndarray:
    """What the sensor shows untouched in the photographs' own light (height, width, 3).

    The median of what no mark is near, where three photographs show that of every pixel. Else the untouched
    picture and a quadratic polynomial of the place, fitted to what no mark is near.
    """
    shape = photographs.shape[1:3]
    circles = [circle for circle in prints if isinstance(circle, Print)]
    clear = [
        ~circle.disc(shape, UNTOUCHED) if isinstance(circle, Print) else np.full(shape, not prints)
        for circle in prints or [""] * len(photographs)
    ]
    if circles and (np.sum(clear, axis=0) >= LEAST_PRINTS).all():
        hidden = np.where(np.array(clear)[..., None], photographs.astype(np.float32), np.nan)
        return np.asarray(np.nanmedian(hidden, axis=0), dtype=np.float64)
    down, across = (2 * part / length - 1 for part, length in zip(np.indices(shape), shape, strict=True))
    terms = np.stack([np.ones(shape), across, down, across**2, across * down, down**2], axis=-1)
    samples = np.concatenate([terms[unmarked][::13] for unmarked in clear])
    change = np.concatenate(
        [
            (photo.astype(np.float64) - untouched)[unmarked][::13]
            for photo, unmarked in zip(photographs, clear, strict=True)
        ]
    )
    weight = np.ones(len(samples))
    # What a mark changes counts little: least absolute errors, by weights.
    for _ in range(8):
        root = np.sqrt(weight)[:, None]
        fitted = np.linalg.lstsq(samples * root, change * root, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(change - samples @ fitted).sum(axis=1), 3.0)
    return np.asarray(untouched + terms @ fitted)
