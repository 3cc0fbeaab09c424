"""The object frame (metres) and the unit frame in which the data set's cameras and lights are drawn."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.renaming import renamed_keywords


@dataclass(frozen=True)
class UnitFrame:
    """The frame in which an object's bounding box is centred and its longest side is 1.

    Parameters
    ----------
    centre
        (3,) centre of the bounding box in the object frame, metres.
    scale
        Longest side of the bounding box, metres.
    """

    centre: np.ndarray
    scale: float

    @classmethod
    def of_points(cls, points: np.ndarray) -> "UnitFrame":
        """Return the unit frame of (n, 3) points in metres."""
        low, high = points.min(axis=0), points.max(axis=0)
        return cls(np.asarray(low + high, dtype=np.float64) / 2, float(np.max(high - low)))

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "UnitFrame":
        """Return the frame that `to_dict` described."""
        return cls(np.asarray(values["centre"], dtype=np.float64), float(values["scale"]))

    def to_dict(self) -> dict[str, Any]:
        """Return the frame as JSON: ``centre`` and ``scale``, metres."""
        return {"centre": [float(value) for value in self.centre], "scale": self.scale}

    def to_unit(self, points: np.ndarray) -> np.ndarray:
        """Map (..., 3) points from the object frame to the unit frame."""
        return (np.asarray(points, dtype=np.float64) - self.centre) / self.scale

    def to_object(self, points: np.ndarray) -> np.ndarray:
        """Map (..., 3) points from the unit frame to the object frame."""
        return np.asarray(points, dtype=np.float64) * self.scale + self.centre

    @renamed_keywords(camera_to_world="camera_to_object")
    def camera_to_unit(self, camera_to_object: np.ndarray) -> np.ndarray:
        """Map (..., 4, 4) camera poses from the object frame to the unit frame."""
        result = np.array(camera_to_object, dtype=np.float64)
        result[..., :3, 3] = self.to_unit(result[..., :3, 3])
        return result

    @renamed_keywords(camera_to_world="camera_to_unit")
    def camera_to_object(self, camera_to_unit: np.ndarray) -> np.ndarray:
        """Map (..., 4, 4) camera poses from the unit frame to the object frame."""
        result = np.array(camera_to_unit, dtype=np.float64)
        result[..., :3, 3] = self.to_object(result[..., :3, 3])
        return result
