"""Touch of an Object File: its compressed surface through the sensor model.

A touch is local geometry seen by a known sensor. The geometry is in the Object File for all senses, so
touch needs no weights of its own: any point, depth, tilt and azimuth is answered by the one renderer
that also made the ground truth.
"""

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.errors import FormatError, QueryError
from objectfolder.products.stored_values import whole_number
from objectfolder.query_values import LARGEST_SEED, image_sides, point_rows, require_room, whole
from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.touches import CONTACTS, Press, Reach, Touches
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.reading import calibrated, checked_background, with_noise
from objectfolder.touch.sensor.sensor import Sensor, stored_sensor

if TYPE_CHECKING:
    from objectfolder.touch.contact.patch import FacePatches

MOST_SAMPLES = 16  # that a file may ask for where a query says nothing
MOST_RAYS_ASKED = 1 << 24  # of an image


class TouchNet:
    """Answers touches on a surface.

    Parameters
    ----------
    surface
        The decoded surface, object frame, metres.
    sensor
        What is pressed; DIGIT by default.
    samples
        Samples along each side of a pixel, unless a query says otherwise.
    contact
        Contact model, ``"rigid"`` or ``"elastic"``, unless a query says otherwise.
    """

    def __init__(
        self, surface: Surface, sensor: Sensor | None = None, samples: int = 2, contact: str = "rigid"
    ) -> None:
        self.surface = surface
        self.sensor = Sensor() if sensor is None else sensor
        self.samples = samples
        self.contact = contact

    @cached_property
    def _patches(self) -> "FacePatches":
        # Here and in `press`: an Object File opens without numba, whose import takes 0.3 s.
        from objectfolder.touch.contact.patch import FacePatches

        return FacePatches(self.surface)

    @cached_property
    def no_contact(self) -> np.ndarray:
        """Image (height, width, 3) uint8 of the untouched gel."""
        return no_contact_image(self.sensor, self.samples)

    def press(
        self,
        points: ArrayLike,
        query: Press | None = None,
        *,
        resolution: int | tuple[int, int] | None = None,
        background: NDArray[np.uint8] | None = None,
        noise_seed: int | Sequence[int] | None = None,
    ) -> Touches:
        """Press at points.

        Parameters
        ----------
        points
            (n, 3), object frame, metres.
        query
            How to press. Where it names no contact model it is elastic if a force is asked for, else the
            net's own; if None, a millimetre along the normal with the net's own model and samples.
        resolution
            Height and width of the images in pixels; the sensor's own if None.
        background
            (height, width, 3) uint8: what a real sensor of this kind sees untouched. Touches are laid over
            it, as `objectfolder.touch.sensor.reading` does.
        noise_seed
            Seed of the sensor's noise, or (n,) one a touch, each then as it is alone; without noise if None.

        Raises
        ------
        QueryError
            As `press` raises, an image that the sensor cannot take, or a background of another size than it.
        """
        from objectfolder.touch.presses.press import press

        query = Press(samples=self.samples) if query is None else query
        points, sensor = point_rows(points, "points"), self.sensor
        if resolution is not None:
            sensor = sensor.at_resolution(*image_sides(resolution, 2))
        pixels = sensor.image_height * sensor.image_width
        if pixels * query.samples**2 > MOST_RAYS_ASKED:
            finding = f"{pixels} pixels of {query.samples**2} rays"
            raise QueryError("resolution", finding, f"Ask for at most {MOST_RAYS_ASKED} rays.")
        require_room("points, resolution", 8 * pixels * len(points), "Press at fewer points at a time.")
        seeds = None if noise_seed is None else _noise_seeds(noise_seed, len(points))
        if background is not None:
            background = checked_background(background, sensor)
        if query.contact is None and query.force_n is None:
            query = replace(query, contact=self.contact)
        try:
            touches = press(self._patches, sensor, points, query)
        except QueryError:
            raise
        except (ArithmeticError, TypeError, ValueError) as error:
            where = "press" if resolution is None else "resolution"
            raise QueryError(where, str(error), "Ask for numbers that this sensor can answer.") from error
        rgb = touches.rgb
        if background is not None:
            rgb = calibrated(rgb, no_contact_image(sensor, query.samples), background, sensor)
        if seeds is not None:
            rgb = with_noise(rgb, sensor, seeds)
        return replace(touches, rgb=rgb)

    def reach(self, points: NDArray[np.float64], query: Press, rolls: int = 24) -> Reach:
        """Try presses at several rolls; see `ObjectFile.reach`."""
        from objectfolder.touch.presses.press import reach

        return reach(self._patches, self.sensor, points, query, whole("rolls", rolls, 1, 360))

    def tensors(self) -> dict[str, np.ndarray]:
        """Return the arrays to store: none but the shared surface's."""
        return {}

    def metadata(self) -> dict[str, Any]:
        """Return the JSON to store."""
        return {"sensor": self.sensor.to_dict(), "samples": self.samples, "contact": self.contact}

    @classmethod
    def from_tensors(
        cls, tensors: Mapping[str, np.ndarray], metadata: Mapping[str, Any], surface: Surface
    ) -> "TouchNet":
        """Return the net that `tensors` and `metadata` described.

        Raises
        ------
        FormatError
            A sensor that cannot be, an unknown contact model, or samples that nobody stores.
        """
        contact = metadata["contact"]
        samples = whole_number("touch.samples", metadata["samples"], 1, MOST_SAMPLES)
        if contact not in CONTACTS:
            raise FormatError("touch.contact", reprlib.repr(contact), f"Known: {', '.join(CONTACTS)}.")
        return cls(surface, stored_sensor(metadata["sensor"], samples), samples, contact)


def _noise_seeds(noise_seed: int | Sequence[int], count: int) -> int | list[int]:
    """Return a seed for all touches, or one for each."""
    if not isinstance(noise_seed, Sequence | np.ndarray) or isinstance(noise_seed, str):
        return whole("noise_seed", noise_seed, 0, LARGEST_SEED)
    if len(noise_seed) != count:
        raise QueryError("noise_seed", f"{len(noise_seed)} for {count} touches", "Give one, or one a touch.")
    return [whole("noise_seed", seed, 0, LARGEST_SEED) for seed in noise_seed]
