"""The views of a product as exporters need them: named, posed in a frame of choice, not yet decoded."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.export.files import write_exr, write_png
from objectfolder.products.store import Product
from objectfolder.renaming import renamed_attribute
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.cameras import focal_length_px

FrameName = Literal["unit", "object"]
NEEDED = ("rgba", "camera_to_world", "light_position", "held_out")


@dataclass(frozen=True)
class PosedViews:
    """Views of one object under a point light each.

    Parameters
    ----------
    rgba
        (n, h, w, 4) float16 scene-linear premultiplied.
    camera_to_object
        (n, 4, 4) poses, OpenGL convention (looks along -z, +y up), in `frame`.
    lights
        (n, 3) places of point lights, in `frame`.
    light_intensity
        Radiant intensity of the point light in watts per steradian, for distances in `frame`: a Lambertian
        surface of albedo a at distance d has the radiance a / pi * intensity * cos / d^2.
    held_out
        (n,) bool: kept from training.
    names
        ``train_0000``, ``test_0000`` and so on, one a view.
    field_of_view_deg
        Over the longer side.
    frame
        ``"unit"``: box centred, longest side 1; ``"object"``: metres.
    unit_frame
        Takes points of the unit frame to metres.
    attributes
        Of the product.
    """

    rgba: np.ndarray
    camera_to_object: np.ndarray
    lights: np.ndarray
    light_intensity: float
    held_out: np.ndarray
    names: tuple[str, ...]
    field_of_view_deg: float
    frame: FrameName
    unit_frame: UnitFrame
    attributes: dict[str, Any]

    camera_to_world = renamed_attribute("camera_to_object")
    light_position = renamed_attribute("lights")

    @classmethod
    def of_product(cls, views: Product, frame: FrameName = "unit", where: str = "views") -> "PosedViews":
        """Return the views of a product of `objectfolder.making.views.views.simulate_views`.

        Raises
        ------
        FormatError
            A product of another kind; `where` names it.
        """
        missing = [name for name in NEEDED if name not in views]
        missing += [
            key for key in ("field_of_view_deg", "frame", "light_power_w") if key not in views.attributes
        ]
        if missing:
            raise FormatError(where, f"no product of views: lacks {', '.join(missing)}", "Give one of views.")
        unit_frame = UnitFrame.from_dict(views.attributes["frame"])
        cameras, lights = views["camera_to_world"], views["light_position"]
        intensity = float(views.attributes["light_power_w"]) / (4 * math.pi)
        if frame == "object":
            cameras, lights = unit_frame.camera_to_object(cameras), unit_frame.to_object(lights)
            # Distances shrink by the scale, so the inverse square law wants a weaker lamp.
            intensity *= unit_frame.scale**2
        held_out = views["held_out"].astype(bool)
        place = np.where(held_out, np.cumsum(held_out), np.cumsum(~held_out)) - 1
        names = tuple(
            f"{'test' if kept else 'train'}_{index:04d}" for kept, index in zip(held_out, place, strict=True)
        )
        return cls(
            views["rgba"], cameras, lights, intensity, held_out, names,
            float(views.attributes["field_of_view_deg"]), frame, unit_frame, dict(views.attributes),
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.names)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return int(self.rgba.shape[1]), int(self.rgba.shape[2])

    @property
    def focal_length_px(self) -> float:
        """Focal length in pixels, the same for both axes: pixels are square."""
        return focal_length_px(self.size, self.field_of_view_deg)

    def write_images(self, folder: Path, linear: Path | None, names: Sequence[str]) -> None:
        """Write a PNG of each view below one folder, and its scene-linear OpenEXR below another if given.

        Raises
        ------
        InputError
            OpenEXR cannot be written.
        """
        for name, rgba in zip(names, self.rgba, strict=True):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_png(folder / f"{name}.png", rgba)
            if linear is not None:
                (linear / name).parent.mkdir(parents=True, exist_ok=True)
                write_exr(linear / f"{name}.exr", rgba)

    def described_frame(self) -> dict[str, Any]:
        """Return the frame of poses and lights as JSON, with the way to metres."""
        centre, scale = [float(value) for value in self.unit_frame.centre], float(self.unit_frame.scale)
        metric = self.frame == "object"
        return {
            "name": self.frame,
            "up": "+z",
            "unit_in_metres": 1.0 if metric else scale,
            "origin_in_metres": [0.0, 0.0, 0.0] if metric else centre,
            "to_metres": "metres = coordinates * unit_in_metres + origin_in_metres",
            "box_centre_m": centre,
            "box_longest_side_m": scale,
        }
