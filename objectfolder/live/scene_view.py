"""A camera that looks at a scene: its rays, what they meet, and where a ball may show in its image."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from objectfolder.vision.cameras import focal_length_px, pixel_rays

Floats = NDArray[np.float64]
Crop = tuple[int, int, int, int]  # (top, left, height, width), pixels
CENTRE = np.array([[0.5, 0.5]])  # of a pixel


@dataclass(frozen=True)
class View:
    """A camera (4, 4), the (height, width) of its image and its field of view, degrees."""

    camera: Floats
    size: tuple[int, int]
    field_of_view_deg: float

    @cached_property
    def rays(self) -> Floats:
        """Unit directions (h, w, 3) in the world through the centres of pixels."""
        pixels = np.arange(self.size[0] * self.size[1])
        _, along = pixel_rays(self.camera, pixels, CENTRE, self.size, self.field_of_view_deg)
        return along.reshape(*self.size, 3)

    @cached_property
    def facing(self) -> Floats:
        """Depth (h, w) that is gained along a unit of each ray."""
        return np.asarray(-(self.rays @ self.camera[:3, 2]))

    def rays_in(self, crop: Crop, offsets: Floats) -> tuple[Floats, Floats]:
        """Return the rays of a part of the image, as `pixel_rays` through offsets (k, 2)."""
        top, left, height, width = crop
        pixels = np.arange(top, top + height)[:, None] * self.size[1] + np.arange(left, left + width)
        return pixel_rays(self.camera, pixels.ravel(), offsets, self.size, self.field_of_view_deg)

    def points(self, depth_m: Floats) -> Floats:
        """Return (h, w, 3) what is seen at the centres of pixels, NaN where nothing is."""
        points, present = np.full((*self.size, 3), np.nan), np.isfinite(depth_m)
        along = depth_m[present] / self.facing[present]
        points[present] = self.camera[:3, 3] + along[:, None] * self.rays[present]
        return points

    def on_plane(self, height_m: float) -> tuple[Floats, Floats]:
        """Return where (h, w, 3) rays meet a level plane, and the depth (h, w) there, infinite for none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (height_m - self.camera[2, 3]) / self.rays[..., 2]
        along = np.where(along > 0, along, np.inf)
        point = self.camera[:3, 3] + np.where(np.isfinite(along), along, 1e6)[..., None] * self.rays
        return point, along * self.facing

    def pixel_m(self, centre: Floats) -> float:
        """Return how wide a pixel is where a point (3,) of the world lies."""
        depth_m = abs(float(moved_by(inverse_pose(self.camera), centre)[2]))
        return depth_m / focal_length_px(self.size, self.field_of_view_deg)

    def crop(self, centre: Floats, radius: float) -> Crop | None:
        """Return the part of the image (top, left, height, width) that a ball may cover; None: no part."""
        x, y, z = moved_by(inverse_pose(self.camera), centre)
        if -z <= radius:
            return None if -z <= -radius else (0, 0, *self.size)
        # A ball's outline lies within that of the cube around it, whose nearest face is at -z - radius.
        focal = focal_length_px(self.size, self.field_of_view_deg)
        sides = np.array([-1, 1])
        corners = np.array([-y, x])[:, None] + sides * radius
        ends = focal * (corners[:, None] / (-z + sides[:, None] * radius)).reshape(2, 4)
        middle, most = np.array(self.size) / 2, np.array(self.size)
        first = np.clip(np.floor(middle + ends.min(axis=1)) - 1, 0, most).astype(int)
        last = np.clip(np.ceil(middle + ends.max(axis=1)) + 1, 0, most).astype(int)
        if (last <= first).any():
            return None
        (top, left), (height, width) = first.tolist(), (last - first).tolist()
        return top, left, height, width


def inverse_pose(pose: Floats) -> Floats:
    """Return the inverse (4, 4) of a rigid pose."""
    inverse = np.eye(4)
    inverse[:3, :3], inverse[:3, 3] = pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def moved_by(pose: Floats, points: Floats) -> Floats:
    """Return points (..., 3) moved by a pose (4, 4)."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])
