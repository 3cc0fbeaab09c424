"""What is asked of a press, and what is known of the touches that follow."""

import reprlib
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import QueryError
from objectfolder.notebook import picture_row
from objectfolder.query_values import real_array
from objectfolder.renaming import renamed_attribute
from objectfolder.touch.sensor.sensor import Sensor

TOLERANCE_M = 1e-6
DEFAULT_DEPTH_M = 0.001
GREATEST_TILT_DEG, GREATEST_TURN_DEG = 45.0, 1e6
LARGEST_FORCE_N = 1e6
# Relative error of a force against a measured one, and how deep it was measured (docs/touch_elastic.md).
FORCE_ERROR, MEASURED_DEPTH_M = 0.03, 0.002
CONTACTS = ("rigid", "elastic")
NOTEBOOK_TOUCHES = 8  # touches in a notebook


@dataclass(frozen=True, eq=False)
class Press:
    """How to press; where a number may differ from touch to touch, a number or (n,).

    Parameters
    ----------
    depth_m
        From first contact on: 0 to the sensor's `maximum_depth_m`, or under the elastic model to
        `elastic_press.greatest_depth_m`. One millimetre where neither a depth nor a force is asked for.
    force_n
        Instead of a depth, the force to press with, newtons, under the elastic model.
    tilt_deg, azimuth_deg
        Lean of the sensor, 0 up to 45 degrees, and its direction, counted from the image's right towards
        its top where the roll is 0.
    roll_deg
        Turn of the leaning sensor about its own axis, the image's right towards its top.
    contact
        ``"rigid"``: the object shows through a gel that gives way where it is, as in TACTO; ``"elastic"``:
        the gel deforms as an elastic solid and bears a force. None stands for elastic where a force is
        asked for, else for rigid.
    samples
        Samples along each side of a pixel, against aliasing.
    cell_m
        Under the elastic model, about the size of the cells of gel that pressure is constant on. Contacts
        less than four cells in radius are a few per cent off. By default about what a pixel of 120 x 160
        shows of a DIGIT's gel.

    Examples
    --------
    >>> Press(force_n=2.0).contact_model, Press(depth_m=0.001).contact_model
    ('elastic', 'rigid')
    """

    depth_m: float | np.ndarray | None = None
    force_n: float | np.ndarray | None = None
    tilt_deg: float | np.ndarray = 0.0
    azimuth_deg: float | np.ndarray = 0.0
    roll_deg: float | np.ndarray = 0.0
    contact: str | None = None
    samples: int = 2
    cell_m: float = 0.03 / 192

    @property
    def contact_model(self) -> str:
        """The contact model asked for.

        Raises
        ------
        QueryError
            An unknown one, or a force asked of the rigid one.
        """
        contact = self.contact
        if contact is None:
            contact = "rigid" if self.force_n is None else "elastic"
        if contact not in CONTACTS:
            raise QueryError("contact", reprlib.repr(contact), "Use 'rigid' or 'elastic'.")
        if contact == "rigid" and self.force_n is not None:
            raise QueryError("force_n", "a rigid contact bears no force", "Ask with contact='elastic'.")
        return contact

    def depths(self, count: int, greatest_m: float) -> np.ndarray:
        """Depths (count,) metres.

        Raises
        ------
        QueryError
            Another shape, or depths outside 0 to `greatest_m`.
        """
        depth = DEFAULT_DEPTH_M if self.depth_m is None else self.depth_m
        return _per_touch("depth_m", depth, count, 0.0, greatest_m, " m")

    def forces(self, count: int) -> np.ndarray | None:
        """Forces (count,) newtons; None where a depth is asked for.

        Raises
        ------
        QueryError
            Another shape, forces below 0, or both a depth and a force.
        """
        if self.force_n is None:
            return None
        if self.depth_m is not None:
            raise QueryError("depth_m, force_n", "both given", "Ask for one of them.")
        return _per_touch("force_n", self.force_n, count, 0.0, LARGEST_FORCE_N, " N")

    def angles(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tilts, azimuths and rolls (count,), radians.

        Raises
        ------
        QueryError
            Another shape, angles that are not finite, tilts outside 0 to 45 degrees.
        """
        tilt = _per_touch("tilt_deg", self.tilt_deg, count, 0.0, GREATEST_TILT_DEG, " degrees")
        azimuth, roll = (
            _per_touch(name, value, count, -GREATEST_TURN_DEG, GREATEST_TURN_DEG, " degrees")
            for name, value in (("azimuth_deg", self.azimuth_deg), ("roll_deg", self.roll_deg))
        )
        return np.radians(tilt), np.radians(azimuth), np.radians(roll)


@dataclass(frozen=True, eq=False, repr=False)
class Touches:
    """n touches; `touches[i]` is one of them, or some, as `Touches`.

    Parameters
    ----------
    rgb
        (n, height, width, 3) uint8, without noise.
    depth_m
        (n, height, width) float32 metres: how far the object, where a pixel sees it, lies inside the
        undeformed gel, along the sensor's axis; the mean over a pixel's samples, 0 where there is none.
    mask
        (n, height, width) bool: at least half of the pixel's samples see the object in the gel.
    sensor_to_object
        (n, 4, 4) float64 pose, metres.
    points, normals
        (n, 3) float64: the touched points of the surface and its mean normals over the contact radius.
    reachable
        (n,) bool: the gel touches the asked point before it is pressed further than asked elsewhere,
        neither the housing nor the room between camera and gel holds a part of the object, and the
        housing's straight way there along the sensor's axis is free.
    first_contact_offset_m
        (n,) float64: how long before the asked point another part of the object meets the gel; the asked
        point itself is `penetration_m - first_contact_offset_m` deep in it (outside where negative).
    penetration_m
        (n,) float64: deepest indentation of the gel by any part of the object, along the sensor's axis.
        It equals the depth asked for, or 0 where the sensor cannot stand. `depth_m` never shows more.
    contact_area_m2
        (n,) float64: area of the object's surface that the camera sees in the gel.
    saturated
        (n,) bool: the gel is pressed as far as it goes, to the sensor's `maximum_depth_m` or to the camera's
        near plane; a larger force would not press it further.
    force_n
        (n,) float64 newtons: force along the sensor's axis; not a number under the rigid model, whose gel
        gives way without any.

    Examples
    --------
    >>> import objectfolder
    >>> bar = objectfolder.load("bar.safetensors")
    >>> touches = bar.press([[0, 0, 0.004]], depth_m=0.001)
    >>> touches, touches[0].normals.round(3).tolist()
    (Touches(1 of 160 x 120 pixels, 1 reachable), [[0.0, 0.0, 1.0]])
    """

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    mask: NDArray[np.bool_]
    sensor_to_object: NDArray[np.float64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    reachable: NDArray[np.bool_]
    first_contact_offset_m: NDArray[np.float64]
    penetration_m: NDArray[np.float64]
    contact_area_m2: NDArray[np.float64]
    saturated: NDArray[np.bool_]
    force_n: NDArray[np.float64]
    depth = renamed_attribute("depth_m")

    @property
    def force_error_n(self) -> NDArray[np.float64]:
        """(n,) float64 newtons: how far `force_n` is expected to be off, with the gel's modulus as given.

        3 % of it, as was measured with a ball in a GelSight Mini (docs/touch_elastic.md). Not a number where
        it was not measured: deeper than 2 mm.
        """
        measured = self.penetration_m <= MEASURED_DEPTH_M + TOLERANCE_M
        return np.where(measured, FORCE_ERROR * self.force_n, np.nan)

    def __repr__(self) -> str:
        count, height, width = self.mask.shape
        reachable = np.count_nonzero(self.reachable)
        return f"Touches({count} of {height} x {width} pixels, {reachable} reachable)"

    def _repr_html_(self) -> str:
        """Return the first images for a notebook."""
        summary = f"{len(self.rgb)} touches, {np.count_nonzero(self.reachable)} of them within reach"
        return f"<div>{summary}</div>{picture_row(self.rgb[:NOTEBOOK_TOUCHES])}"

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: int | slice | NDArray[np.bool_] | NDArray[np.integer]) -> "Touches":
        """Return one touch or some of them, as n touches."""
        if isinstance(rows, int | np.integer):
            rows = np.arange(len(self))[[rows]]
        return Touches(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})

    def __iter__(self) -> Iterator["Touches"]:
        return (self[row] for row in range(len(self)))

    @classmethod
    def empty(cls, count: int, sensor: Sensor) -> "Touches":
        """`count` touches to be filled in."""
        image = (count, sensor.image_height, sensor.image_width)
        return cls(
            rgb=np.zeros((*image, 3), dtype=np.uint8),
            depth_m=np.zeros(image, dtype=np.float32),
            mask=np.zeros(image, dtype=bool),
            sensor_to_object=np.zeros((count, 4, 4)),
            points=np.zeros((count, 3)),
            normals=np.zeros((count, 3)),
            reachable=np.zeros(count, dtype=bool),
            first_contact_offset_m=np.zeros(count),
            penetration_m=np.zeros(count),
            contact_area_m2=np.zeros(count),
            saturated=np.zeros(count, dtype=bool),
            force_n=np.full(count, np.nan),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Reach:
    """At which rolls of the sensor n points can be pressed.

    Parameters
    ----------
    roll_deg
        (n, rolls) degrees, evenly round a turn from the roll asked for on.
    reachable
        (n, rolls) bool, as of `Touches`.
    """

    roll_deg: NDArray[np.float64]
    reachable: NDArray[np.bool_]

    def __repr__(self) -> str:
        count, rolls = self.reachable.shape
        return f"Reach({count} points at {rolls} rolls, {np.count_nonzero(self.at_some_roll)} reachable)"

    @property
    def at_some_roll(self) -> NDArray[np.bool_]:
        """(n,) bool: whether a point is reachable at any of the rolls."""
        return np.asarray(self.reachable.any(axis=1))

    @property
    def best_roll_deg(self) -> NDArray[np.float64]:
        """(n,) degrees: the reachable roll with most room to both sides; not a number where there is none.

        Of equal ones it is that nearest to the roll asked for.
        """
        rolls = self.reachable.shape[1]
        order = sorted(range(rolls), key=lambda column: (min(column, rolls - column), column))
        best = np.full(len(self.reachable), np.nan)
        for row, fits in enumerate(self.reachable):
            blocked = np.flatnonzero(~fits)
            if fits.any():
                apart = np.abs(np.array(order)[:, None] - blocked)
                room = np.minimum(apart, rolls - apart).min(axis=1, initial=rolls)
                best[row] = self.roll_deg[row, order[int(np.argmax(room))]]
        return best


def saturation_depth_m(sensor: Sensor) -> float:
    """Deepest indentation of the gel, metres: its limit, or where the camera's near plane ends it."""
    clear = sensor.gel_apex_m[0] - sensor.camera_position_m[0] - sensor.near_m
    return min(sensor.maximum_depth_m, clear)


def _per_touch(
    name: str, value: float | np.ndarray, count: int, low: float, high: float, unit: str
) -> np.ndarray:
    """A number, or one a touch, as (count,) float64 from `low` to `high`."""
    values = real_array(name, value, "Give a number, or one a touch.")
    if values.shape not in ((), (count,)):
        raise QueryError(name, f"shape {values.shape}", f"Give a number or ({count},).")
    outside = (values < low) | (values > high)
    if outside.any():
        finding = f"{values[outside].ravel()[0]}{unit} is out of range"
        raise QueryError(name, finding, f"Ask for {low:g} to {high:g}{unit}.")
    return np.broadcast_to(values, (count,))
