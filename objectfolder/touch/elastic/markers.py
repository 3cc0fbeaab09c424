"""Markers printed on a gel, as the camera sees them move: GelSight's way to show shear."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from objectfolder.query_values import real, whole
from objectfolder.touch.elastic.contact_problem import Contact
from objectfolder.touch.elastic.shear import Shear
from objectfolder.touch.sensor.gel import gel_along_rays, gel_surface
from objectfolder.touch.sensor.magnification import pixels_per_metre
from objectfolder.touch.sensor.marker_grid import MOST_MARKERS
from objectfolder.touch.sensor.sensor import Sensor

MARKER_ROWS, MARKER_COLUMNS = 9, 7  # of a GelSight Mini


@dataclass(frozen=True, eq=False)
class Markers:
    """n markers on a gel.

    Parameters
    ----------
    rest_m
        (n, 3) float64 where they are on the untouched gel, sensor frame.
    displacement_m
        (n, 3) float64, sensor frame.
    rest_pixels, pixels
        (n, 2) float64 row and column where the camera sees them then and now; whole numbers are the middles
        of pixels.
    radius_pixels
        Of a dot as the camera sees it.
    """

    rest_m: np.ndarray
    displacement_m: np.ndarray
    rest_pixels: np.ndarray
    pixels: np.ndarray
    radius_pixels: float = 1.5

    def drawn_on(self, rgb: np.ndarray, radius_pixels: float | None = None) -> np.ndarray:
        """Return an image (height, width, 3) uint8 with a black dot at every marker, smooth at its rim.

        Parameters
        ----------
        radius_pixels
            Of a dot; by default the markers' own.

        Raises
        ------
        QueryError
            A radius that is not from 0 to 100 pixels.
        """
        radius = self.radius_pixels if radius_pixels is None else radius_pixels
        radius = real("radius_pixels", radius, 0.0, 100.0)
        light, reach = np.ones(rgb.shape[:2]), int(np.ceil(radius + 0.5))
        for row, column in self.pixels:
            top, left = max(0, round(row) - reach), max(0, round(column) - reach)
            window = light[top : max(0, round(row) + reach + 1), left : max(0, round(column) + reach + 1)]
            down, right = (np.arange(size) for size in window.shape)
            away = np.hypot(top + down[:, None] - row, left + right - column)
            np.minimum(window, np.clip(away - radius + 0.5, 0.0, 1.0), out=window)
        return np.asarray(np.rint(rgb * light[..., None]).astype(np.uint8))


def moved_markers(
    sensor: Sensor, contact: Contact, shear: Shear, grid: tuple[int, int] | None = None
) -> Markers:
    """Markers in a grid on the untouched gel, moved by a sheared contact.

    Parameters
    ----------
    sensor
        Whose gel it is.
    contact, shear
        On cells over the whole gel, as of `height_field.gel_grid`.
    grid
        Rows and columns of markers evenly apart in the image; by default the sensor's own grid, as far as it
        lies on the gel, or 9 x 7 where it has none.

    Raises
    ------
    QueryError
        Not whole numbers of rows and columns.

    Examples
    --------
    >>> import numpy as np
    >>> from objectfolder.touch import Elastomer, Sensor, solve_contact, solve_shear
    >>> y, z = np.meshgrid(np.linspace(-0.01, 0.01, 41)[:-1], np.linspace(-0.015, 0.015, 61)[:-1])
    >>> gel = Elastomer(5.6e5, 0.48, 0.004)
    >>> contact = solve_contact((y**2 + z**2) / 0.04, 0.0005, gel, force_n=4.0)
    >>> markers = moved_markers(Sensor(), contact, solve_shear(contact, gel, 1.0, (0.0, 2.0)))
    >>> right = markers.pixels[:, 1] - markers.rest_pixels[:, 1]
    >>> len(right), round(right.max(), 1)
    (63, 3.1)
    """
    rest, pixels, radius = markers_at_rest(sensor, grid)
    places = cells_at(sensor, rest, contact.displacement_m.shape)
    # Rows descend in z and columns in y, and the gel gives way along -x.
    fields = (-contact.displacement_m, -shear.displacement_m[1], -shear.displacement_m[0])
    displacement = np.stack(
        [map_coordinates(field, places, order=1, mode="nearest") for field in fields], axis=1
    )
    return Markers(rest, displacement, pixels, _seen(sensor, rest + displacement), radius)


def markers_at_rest(
    sensor: Sensor, grid: tuple[int, int] | None = None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Markers of `moved_markers` on the untouched gel: `rest_m`, `rest_pixels` and `radius_pixels`."""
    own = sensor.marker_grid if grid is None else None
    if own is None:
        pixels, radius = (
            _spread(sensor, (MARKER_ROWS, MARKER_COLUMNS) if grid is None else grid),
            Markers.radius_pixels,
        )
    else:
        scale = pixels_per_metre(sensor)
        pixels, radius = image_middle(sensor) + own.places_m() * scale, own.dot_radius_m * scale
    tangents = _tangents(sensor, pixels)
    y, z = (tangents * gel_along_rays(sensor, *tangents)) + np.array(sensor.camera_position_m)[1:, None]
    if own is not None:
        across, up = np.abs(y - sensor.gel_apex_m[1]), np.abs(z - sensor.gel_apex_m[2])
        on_gel = (across < sensor.gel_width_m / 2) & (up < sensor.gel_height_m / 2)
        y, z, pixels = y[on_gel], z[on_gel], pixels[on_gel]
    return np.stack([gel_surface(sensor, y, z), y, z], axis=1), pixels, radius


def cells_at(sensor: Sensor, points: np.ndarray, cells: tuple[int, ...]) -> np.ndarray:
    """Rows and columns (2, n), parts of a cell included, of points (n, 3) on a gel of `cells`."""
    down = (points[:, 2] - sensor.gel_apex_m[2]) / sensor.gel_height_m
    right = (points[:, 1] - sensor.gel_apex_m[1]) / sensor.gel_width_m
    return np.stack([(0.5 - down) * cells[0] - 0.5, (0.5 - right) * cells[1] - 0.5])


def _spread(sensor: Sensor, grid: tuple[int, int]) -> np.ndarray:
    """Pixels (n, 2) of `rows` by `columns` points evenly apart in a sensor's image."""
    rows, columns = (whole("grid", count, 1, MOST_MARKERS) for count in grid)
    down = (np.arange(rows) + 0.5) / rows * sensor.image_height - 0.5
    right = (np.arange(columns) + 0.5) / columns * sensor.image_width - 0.5
    return np.stack([part.ravel() for part in np.meshgrid(down, right, indexing="ij")], axis=1)


def image_middle(sensor: Sensor) -> np.ndarray:
    """Pixel row and column of the middle of a sensor's image."""
    return (np.array([sensor.image_height, sensor.image_width]) - 1) / 2


def pixel_slope(sensor: Sensor) -> float:
    """Slope of the camera's rays from one pixel to the next."""
    return float(2 * np.tan(np.radians(sensor.field_of_view_deg) / 2) / sensor.image_height)


def _tangents(sensor: Sensor, pixels: np.ndarray) -> np.ndarray:
    """Slopes (2, n) along y and z of the camera's rays through pixels (n, 2)."""
    return np.asarray(((image_middle(sensor) - pixels) * pixel_slope(sensor)).T[::-1])


def _seen(sensor: Sensor, points: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) at which the camera sees points (n, 3) of the sensor frame."""
    away = points - np.array(sensor.camera_position_m)
    return np.asarray(image_middle(sensor) - away[:, :0:-1] / away[:, :1] / pixel_slope(sensor))
