"""Conditions of a view away from a data set's own: finer images, other lamps, environments."""

from dataclasses import dataclass

RESOLUTION_PX = 128


@dataclass(frozen=True)
class Condition:
    """How a view is taken.

    Parameters
    ----------
    resolution_px
        Side of the whole image.
    lamp_distance
        Of the point light from the origin, unit frame.
    environment
        Name of an environment in place of the light, or None.
    """

    resolution_px: int = RESOLUTION_PX
    lamp_distance: float = 1.0
    environment: str | None = None


CONDITIONS = {
    "128_px": Condition(),
    "256_px": Condition(resolution_px=256),
    "512_px": Condition(resolution_px=512),
    "near_lamp": Condition(lamp_distance=0.6),
    "far_lamp": Condition(lamp_distance=3.0),
    "window": Condition(environment="window"),
    "sky": Condition(environment="sky"),
}
