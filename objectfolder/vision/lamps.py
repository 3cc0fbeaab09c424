"""Point lights of a view, as a query gives them."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

# Of the data set's lamp. An albedo of 0.8 that faces the light from 0.5 reaches a radiance of 0.97, so that
# only surfaces very close to the lamp clip: radiance = albedo P cos / (4 pi^2 d^2).
LIGHT_POWER_W = 12.0


@dataclass(frozen=True, eq=False)
class Lamps:
    """Point lights with colours; where all are white, an array of positions does.

    Their power is that of the data set's lamp, which lies at one `frame.scale` from the centre of the object,
    times the colour. It falls off with the square of the distance.

    Parameters
    ----------
    positions_m
        (3,), one light for all views; (n, 3), one a view; or (n, k, 3), k a view; metres, object frame.
    colours
        (3,), (k, 3) or (n, k, 3) linear factors of the power, red, green, blue; 1 if None.

    Examples
    --------
    >>> import objectfolder
    >>> bar = objectfolder.load("bar.safetensors")
    >>> cameras, lights = bar.sample_views(2)
    >>> red = bar.render(cameras, Lamps(lights, colours=[1.0, 0.0, 0.0]), resolution=64)
    >>> int(red[0, ..., 1].min()) < int(red[0, ..., 0].max())
    True
    """

    positions_m: ArrayLike
    colours: ArrayLike | None = None
