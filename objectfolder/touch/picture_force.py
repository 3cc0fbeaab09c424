"""Force from one picture of a gel: its colours give slopes, slopes a height map, the height map a pressure.

Shadows are cast by the height map, and taken off. The pressure is that which
moves the gel so where it is touched. Which level of the height map bounds the contact is not seen: it is the
one whose gel has the slopes of the picture beside the contact as well. That gel bulges beyond it, which gives
the map's zero. A sensor with an indentation response does not show that bulge (`response_contact.py`).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dstn, idstn

from objectfolder.errors import QueryError
from objectfolder.touch.elastic.contact_problem import Contact, solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.picture_slopes import pixel_places, pixel_slopes
from objectfolder.touch.rendering.shadows import shadow_caster
from objectfolder.touch.response_contact import ResponseContact
from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.marker_tracking import without_markers
from objectfolder.touch.sensor.reading import checked_background
from objectfolder.touch.sensor.sensor import Sensor

Floats = NDArray[np.float64]
AVERAGED_PX = 2  # pixels of a side that are averaged
# Of a value that shows a touch, above rounding; of a shadow, that is taken off.
CHANGE, LEAST_LIGHT = 0.6 / 255, 0.2
SEARCH_ROUNDS = 3
# Of the contact's border, over the deepest displacement; and nearer ones round the best.
BORDER_LEVELS, NEARER = np.arange(0.05, 0.96, 0.1), np.arange(-0.05, 0.06, 0.025)
# Of squared slopes: of round objects less is, of most edges more; with an indentation response.
UNEXPLAINED, RESPONSE_UNEXPLAINED = 0.07, 0.1
STEEP, BEYOND = "its contact has steep walls or hardly shows", "its contact reaches the border"
# Relative, of simulated touches of round objects (docs/touch_elastic.md); with an indentation response.
PICTURE_FORCE_ERROR, RESPONSE_FORCE_ERROR = 0.1, 0.25


class PictureForce(NamedTuple):
    """Force along the sensor's axis, and how far it may be off, newtons."""

    force_n: float
    force_error_n: float


def force_of(picture: NDArray[np.uint8], sensor: Sensor) -> PictureForce:
    """Return the force that a picture of a sensor's gel shows.

    It holds for one round object within the picture, without noise. The error is that of simulated touches,
    which are drawn by the same sensor, and takes the gel's modulus as given: the force is proportional to it.

    Parameters
    ----------
    picture
        (height, width, 3) uint8, as a press shows it or laid over the untouched gel of the sensor's model.
        What markers hide is filled, if the sensor has some.

    Raises
    ------
    QueryError
        Another size or type, a contact at the border of the picture, or one with steep walls (an edge, a flat
        face, or less than shows), whose depth the picture does not tell.

    Examples
    --------
    >>> from objectfolder.touch import Press, force_of, press, read_sensor
    >>> from trimesh.creation import icosphere
    >>> from objectfolder.surface.surface import Surface
    >>> ball, sensor = icosphere(4, 0.006), read_sensor("digit-tacto")
    >>> touch = press(Surface(ball.vertices, ball.faces), sensor, [[0, 0, 0.006]], Press(force_n=3.0))
    >>> 2.7 < force_of(touch.rgb[0], sensor).force_n < 3.3
    True
    """
    shape = sensor.image_height // AVERAGED_PX, sensor.image_width // AVERAGED_PX
    gel = without_markers(checked_background(picture, sensor), sensor)
    whole = gel[: shape[0] * AVERAGED_PX, : shape[1] * AVERAGED_PX].astype(np.float64)
    small = sensor.at_resolution(*shape)
    colours = whole.reshape(shape[0], AVERAGED_PX, shape[1], AVERAGED_PX, 3).mean(axis=(1, 3)) / 255
    changed = (np.abs(colours - ray_grid(small, 1).gel_values.reshape(colours.shape)) > CHANGE).any(axis=-1)
    if not changed.any():
        return PictureForce(0.0, 0.0)
    shadows, height, light = shadow_caster(small), np.zeros(shape), np.ones(1)
    for _ in range(SEARCH_ROUNDS if shadows is not None or sensor.indentation_response is None else 1):
        place = pixel_places(small, height)
        slopes = pixel_slopes(small, np.minimum(colours / light, 1.0), changed, place)
        height = _height(*slopes)
        height -= np.median(height[~changed]) if not changed.all() else 0.0
        if shadows is not None:
            light = np.maximum(shadows.light(np.maximum(height, 0).astype(np.float32)), LEAST_LIGHT)
    if sensor.indentation_response is not None:
        return _force_beside_response(colours / light, height, slopes, place, small)
    contact, level, _ = _contact(small, height, slopes, place, BORDER_LEVELS)
    if contact.reaches_border:
        raise QueryError("picture", BEYOND, "Press nearer the middle.")
    if not changed.all():
        height += np.median((contact.displacement_m - height)[~changed])
    contact, _, unexplained = _contact(small, height, slopes, place, level + NEARER)
    if level == BORDER_LEVELS[0] or unexplained > UNEXPLAINED:
        raise QueryError("picture", STEEP, "Press something round.")
    return PictureForce(contact.force_n, PICTURE_FORCE_ERROR * contact.force_n)


def _force_beside_response(
    colours: Floats, height: Floats, slopes: tuple[Floats, Floats], place: Floats, sensor: Sensor
) -> PictureForce:
    """Force of a picture whose gel beyond the contact is seen by an indentation response."""
    gel = ray_grid(sensor, 1).gel_values.reshape(colours.shape).astype(np.float64)
    answer = ResponseContact(np.minimum(colours, 1.0), gel, sensor).solve(height, slopes, place)
    if answer is None:
        raise QueryError("picture", "no round contact explains it", "Press something round, in its middle.")
    if answer[1] > RESPONSE_UNEXPLAINED:
        raise QueryError("picture", STEEP, "Press something round.")
    contact, _ = answer
    if contact.reaches_border:
        raise QueryError("picture", BEYOND, "Press nearer the middle.")
    return PictureForce(contact.force_n, RESPONSE_FORCE_ERROR * contact.force_n)


def _height(down: Floats, right: Floats) -> Floats:
    """Integrate rises to a height map that is 0 beyond the borders, by least squares."""
    rise_down, rise_right = (down[1:] + down[:-1]) / 2, (right[:, 1:] + right[:, :-1]) / 2
    source = np.zeros_like(down)
    source[:-1] -= rise_down
    source[1:] += rise_down
    source[:, :-1] -= rise_right
    source[:, 1:] += rise_right
    rows, columns = (2 - 2 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1)) for n in down.shape)
    return np.asarray(idstn(dstn(source, type=1) / (rows[:, None] + columns), type=1))


def _contact(
    sensor: Sensor, height: Floats, slopes: tuple[Floats, Floats], place: Floats, levels: Floats
) -> tuple[Contact, float, float]:
    """Contact that moves the gel to a height map where it is touched, by the best level of its border.

    Also that level, and the share of the squared slopes that the contact's gel does not have.
    """
    deepest = np.unravel_index(int(height.argmax()), height.shape)
    pitch = (
        float(abs(np.gradient(place[2], axis=0)[deepest])),
        float(abs(np.gradient(place[1], axis=1)[deepest])),
    )
    gel = Elastomer(sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio, sensor.gel_thickness_m)
    top, least, answer = float(height.max()), np.inf, None
    for level in levels:
        gap = np.where(height > level * top, top - height, np.inf)
        contact = solve_contact(gap, pitch, gel, indentation_m=top, tolerance=1e-3)
        rises = np.gradient(contact.displacement_m)
        off = sum(float(np.sum((rise - slope) ** 2)) for rise, slope in zip(rises, slopes, strict=True))
        if off < least:
            least, answer = off, (contact, float(level))
    assert answer is not None
    return *answer, least / sum(float(np.sum(slope**2)) for slope in slopes)
