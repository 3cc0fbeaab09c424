"""The contact that a picture shows of a sensor with an indentation response.

Beyond a contact such a sensor shows the untouched gel and its response to the indentation, and not how the
gel leans. So the slopes in the contact alone tell the object's shape, and the contact's border how far it
came on. Where the border lies and what the response adds depend on each other. The border is first that level
of the height map of all slopes which leaves least of the picture beyond it unexplained. From then on it is
where the picture departs from the response.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.optimize import brentq
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from objectfolder.touch.elastic.contact_problem import Contact, solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.picture_slopes import pixel_places, pixel_slopes
from objectfolder.touch.sensor.indentation_response import ResponseField
from objectfolder.touch.sensor.sensor import Sensor

Floats = NDArray[np.float64]
Region = NDArray[np.bool_]
# Of the deepest height, among which the first border is; and nearer ones round the best.
FIRST_LEVELS, NEARER_LEVELS = np.array([0.05, 0.1, 0.2, 0.3, 0.45, 0.6]), np.arange(-0.075, 0.08, 0.025)
# A border that leaves so much more unexplained is no better; and what the best may leave: round objects leave
# less than half of it.
BORDER_ROUNDS, WORSE, UNEXPLAINED_BEYOND = 3, 1.5, 0.15
# The border is where the departure from the response is this share of the largest within `RIM_PX` pixels, and
# at least that share of a usual departure.
BORDER_SHARE, RIM_PX, LEAST_DEPARTURE = 0.5, 3, 0.2
# Pixels at the border that slopes are not taken from, and beyond it, where the shape is carried on.
UNSURE_PX, CARRIED_PX = 2, 5
SMALLEST_CORE_PX = 9


class _Candidate(NamedTuple):
    """A contact, the level of the height map that bounds it, and how much it leaves unexplained."""

    level: float
    border: Region
    contact: Contact
    unexplained: float


class ResponseContact:
    """Contacts of a picture, by borders.

    Parameters
    ----------
    seen, gel
        (rows, columns, 3) values 0..1: the picture less its shadows, and the untouched gel.
    sensor
        With a response, of the picture's size.
    """

    def __init__(self, colours: Floats, gel: Floats, sensor: Sensor) -> None:
        assert sensor.indentation_response is not None
        self._colours, self._gel, self._sensor = colours, gel, sensor
        self._response = ResponseField(sensor.indentation_response, *colours.shape[:2])
        thickness = sensor.gel_thickness_m
        self._elastomer = Elastomer(sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio, thickness)

    def solve(
        self, height: Floats, slopes: tuple[Floats, Floats], place: Floats
    ) -> tuple[Contact, float] | None:
        """Return the contact, and the share of the squared slopes in it that its gel does not have.

        None where no contact explains the picture. `slopes` are those of all pixels, (rows, columns) of rises
        from row to row and from column to column, and `height` their map; `place` (3, rows, columns), all
        metres.
        """
        best = self._best(height, slopes, place, FIRST_LEVELS)
        if best is not None:
            best = self._best(height, slopes, place, best.level + NEARER_LEVELS)
        if best is None:
            return None
        border, contact, unexplained = best.border, best.contact, best.unexplained
        for _ in range(BORDER_ROUNDS):
            nearer = _border(self._departure(border, contact))
            place = pixel_places(self._sensor, np.maximum(contact.displacement_m, 0))
            rises = pixel_slopes(self._sensor, self._colours, nearer, place)
            solved = self._contact(nearer, rises, place, 0.002)
            if solved is None or self._unexplained(nearer, solved) > WORSE * unexplained:
                break
            border, contact, slopes = nearer, solved, rises
            unexplained = self._unexplained(border, contact)
        if unexplained > UNEXPLAINED_BEYOND:
            return None
        inner = ndimage.binary_erosion(border, iterations=UNSURE_PX)
        off, whole = 0.0, 0.0
        for rise, slope in zip(np.gradient(contact.displacement_m), slopes, strict=True):
            off += float(np.sum((rise - slope)[inner] ** 2))
            whole += float(np.sum(slope[inner] ** 2))
        return contact, off / whole

    def _best(
        self, height: Floats, slopes: tuple[Floats, Floats], place: Floats, levels: Floats
    ) -> _Candidate | None:
        """The contact with the border at that level of a height map which leaves least unexplained."""
        candidates = []
        for level in levels[levels > 0]:
            border = _largest(height > level * height.max())
            contact = self._contact(border, slopes, place, 0.05)
            if contact is not None:
                unexplained = self._unexplained(border, contact)
                candidates.append(_Candidate(float(level), border, contact, unexplained))
        return min(candidates, key=lambda candidate: candidate.unexplained, default=None)

    def _unexplained(self, border: Region, contact: Contact) -> float:
        """Departure from the response beyond a border, rms, of that within."""
        departure = self._departure(border, contact)
        beyond, within = (float(np.mean(departure[part] ** 2)) for part in (~border, border))
        return float(np.sqrt(beyond / within))

    def _departure(self, border: Region, contact: Contact) -> Floats:
        """How far (rows, columns) the picture is from the gel and its response, as if nothing touched it."""
        change = self._response.change(np.where(border, np.maximum(contact.displacement_m, 0), 0.0))
        return np.asarray(np.linalg.norm(self._colours - self._gel - change, axis=-1))

    def _contact(
        self, border: Region, slopes: tuple[Floats, Floats], place: Floats, exactness: float
    ) -> Contact | None:
        """The contact with the shape of the slopes that is as large as a border (rows, columns)."""
        inner = ndimage.binary_erosion(border, iterations=UNSURE_PX)
        if inner.sum() < SMALLEST_CORE_PX:
            return None
        down, right, region = _carried_on(slopes, inner)
        gap = -_heights(down, right, region)
        deepest = np.unravel_index(int(gap.argmin()), gap.shape)
        pitch = (
            float(abs(np.gradient(place[2], axis=0)[deepest])),
            float(abs(np.gradient(place[1], axis=1)[deepest])),
        )
        area = float(border.sum()) * pitch[0] * pitch[1]
        span = float(gap[border & region].max())

        def contact(indentation: float) -> Contact:
            return solve_contact(gap, pitch, self._elastomer, indentation_m=indentation, tolerance=1e-3)

        def excess(indentation: float) -> float:
            return contact(indentation).contact_area_m2 - area

        low, high = 0.1 * span, 3 * span
        if not span > 0 or excess(low) > 0 or excess(high) < 0:
            return None
        return contact(float(brentq(excess, low, high, xtol=exactness * span)))


def _largest(region: Region) -> Region:
    """The largest connected part of a region, without holes."""
    labels, count = ndimage.label(region)
    sizes = ndimage.sum_labels(region, labels, np.arange(1, count + 1))
    return np.asarray(ndimage.binary_fill_holes(labels == 1 + int(np.argmax(sizes))))


def _border(departure: Floats) -> Region:
    """Where the picture departs from the response by half of what it does at the rim near by."""
    smooth = ndimage.gaussian_filter(departure, 0.5)
    usual = np.median(smooth[smooth > smooth.max() / 2])
    near = BORDER_SHARE * ndimage.maximum_filter(smooth, 2 * RIM_PX + 1)
    return _largest((smooth > near) & (smooth > LEAST_DEPARTURE * usual))


def _carried_on(slopes: tuple[Floats, Floats], core: Region) -> tuple[Floats, Floats, Region]:
    """Slopes of a core carried on round it, by what lies as far inside its border; and where they are."""
    region = np.asarray(ndimage.binary_dilation(core, iterations=CARRIED_PX))
    border = ndimage.distance_transform_edt(~core, return_distances=False, return_indices=True)
    far = np.asarray(core.shape)[:, None, None] - 1
    inside = np.clip(2 * border - np.indices(core.shape), 0, far)
    down, right = (
        np.where(core, slope, np.where(region, 2 * slope[tuple(border)] - slope[tuple(inside)], 0.0))
        for slope in slopes
    )
    return down, right, region


def _heights(down: Floats, right: Floats, region: Region) -> Floats:
    """Integrate rises over a region by least squares; 0 at the highest pixel, -inf elsewhere."""
    number = np.full(region.shape, -1)
    number[region] = np.arange(region.sum())
    pairs, rises = [], []
    for axis, slope in enumerate((down, right)):
        along, moved = np.moveaxis(number, axis, 0), np.moveaxis(slope, axis, 0)
        later, earlier = along[1:], along[:-1]
        joined = (later >= 0) & (earlier >= 0)
        pairs.append(np.stack([later[joined], earlier[joined]]))
        rises.append(((moved[1:] + moved[:-1]) / 2)[joined])
    ends, rise = np.concatenate(pairs, axis=1), np.concatenate(rises)
    each = np.arange(len(rise))
    signs = np.concatenate([np.ones(len(rise)), -np.ones(len(rise))])
    shape = (len(rise), int(region.sum()))
    edges: Any = coo_array((signs, (np.tile(each, 2), ends.ravel())), shape).tocsr()
    # The first height is free: it is held at 0.
    anchor = coo_array(([1.0], ([0], [0])), (shape[1], shape[1]))
    heights = spsolve((edges.T @ edges + anchor).tocsc(), edges.T @ rise)
    whole = np.full(region.shape, -np.inf)
    whole[region] = heights - heights.max()
    return whole
