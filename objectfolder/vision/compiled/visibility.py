"""What a camera sees at each sub-sample of each pixel: few of them where a pixel is even, many where not."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from objectfolder.vision.cameras import focal_length_px, sub_ray_offsets
from objectfolder.vision.compiled.borders import neighbours, unevenly_seen
from objectfolder.vision.compiled.grouping import group_samples
from objectfolder.vision.compiled.rasteriser import edge_functions, rasterise

# What a pixel looks like depends on neighbours at most this far away, pixels.
MARGIN_PX = 2
# Pixels of outlines that are sampled at a time: 130 MB at 1024 sub-samples.
OUTLINE_AT_ONCE = 1 << 14
# (top, left, height, width) of a part of an image, pixels.
Crop = tuple[int, int, int, int]


@dataclass(frozen=True)
class Projection:
    """The faces as a camera projects them, and the window of the image in which they may show.

    Parameters
    ----------
    functions, reach
        As of `rasteriser.edge_functions`.
    camera_to_world
        (4, 4).
    focal, centre
        Pixels.
    top, left, height, width
        The window, pixels; empty where nothing is to be seen.
    """

    functions: np.ndarray
    reach: np.ndarray
    camera_to_world: np.ndarray
    focal: float
    centre: tuple[float, float]
    top: int
    left: int
    height: int
    width: int

    @classmethod
    def of(
        cls,
        vertices: np.ndarray,
        faces: np.ndarray,
        camera_to_world: np.ndarray,
        size: tuple[int, int],
        field_of_view_deg: float,
        crop: Crop,
        margin: int,
    ) -> "Projection":
        """Project (V, 3) world vertices of (F, 3) faces; see no further than `margin` beyond `crop`."""
        pose = np.ascontiguousarray(camera_to_world, dtype=np.float64)
        focal, centre = focal_length_px(size, field_of_view_deg), (size[1] / 2.0, size[0] / 2.0)
        local = np.ascontiguousarray((vertices - pose[:3, 3]) @ pose[:3, :3])
        functions, reach = edge_functions(local, faces, focal, *centre)
        left = max(reach[:, 0].min(), crop[1] - margin, 0.0)
        right = min(reach[:, 1].max(), crop[1] + crop[3] + margin, size[1])
        top = max(reach[:, 2].min(), crop[0] - margin, 0.0)
        bottom = min(reach[:, 3].max(), crop[0] + crop[2] + margin, size[0])
        if not (left < right and top < bottom):
            return cls(functions, reach, pose, focal, centre, 0, 0, 0, 0)
        height, width = int(np.ceil(bottom)) - int(top), int(np.ceil(right)) - int(left)
        return cls(functions, reach, pose, focal, centre, int(top), int(left), height, width)

    def sample(self, slots: np.ndarray, count: int, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return face (-1: none) and one over depth (count, s) at (2, s) offsets in pixels with a slot."""
        front_faces = np.full((count, offsets.shape[1]), -1, dtype=np.int32)
        nearness = np.zeros(front_faces.shape, dtype=np.float32)
        rasterise(self.functions, self.reach, slots, (self.top, self.left), offsets, front_faces, nearness)
        return front_faces, nearness


@dataclass(frozen=True)
class Samples:
    """Sub-samples of some pixels, equally many of each.

    Parameters
    ----------
    start
        Number of the first of these pixels among all of the view.
    front_faces, label
        (p, s) face and group of each sub-sample.
    offsets
        (2, s) of the sub-samples from the centre.
    """

    start: int
    front_faces: np.ndarray
    label: np.ndarray
    offsets: np.ndarray

    @property
    def pixels(self) -> slice:
        """Which pixels of the view these are."""
        return slice(self.start, self.start + len(self.front_faces))


@dataclass(frozen=True)
class View:
    """What a camera sees: the pixels (p,) of a window that see anything, even ones first.

    Parameters
    ----------
    projection
        Of the camera.
    slots
        (h, w) int32 of the window: pixel, or -1.
    columns, rows
        (p,) centres of the pixels in the image.
    coverage, alpha
        (p,) share of the pixel that sees the surface: of its sub-samples, and at outlines of more of them.
    samples
        Of the even and of the uneven pixels.
    """

    projection: Projection
    slots: np.ndarray
    columns: np.ndarray
    rows: np.ndarray
    coverage: np.ndarray
    alpha: np.ndarray
    samples: tuple[Samples, Samples]

    @cached_property
    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """The pixels (k,) on both sides of each edge between two."""
        return neighbours(self.slots)

    def places(
        self, samples: Samples, pixel: np.ndarray, sample: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the face seen and the image point x, y of sub-samples (n,) of pixels (n,) of `samples`."""
        x = self.columns[samples.pixels][pixel] + samples.offsets[0, sample]
        y = self.rows[samples.pixels][pixel] + samples.offsets[1, sample]
        return samples.front_faces[pixel, sample], x, y


def look(
    projection: Projection, facets: np.ndarray, samples: int, samples_uneven: int, samples_outline: int
) -> View:
    """Find what is seen, with more sub-samples in pixels where a smooth piece of surface ends.

    Parameters
    ----------
    facets
        (F, 3) unit normals.
    samples, samples_uneven
        Sub-samples of an even and of an uneven pixel.
    samples_outline
        Of a pixel that is covered in part, for its coverage alone.
    """
    height, width = projection.height, projection.width

    def grouped(slots: np.ndarray, count: int, per_pixel: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        offsets = np.ascontiguousarray((sub_ray_offsets(per_pixel) - 0.5).astype(np.float32).T)
        front_faces, nearness = projection.sample(slots, count, offsets)
        rows, columns = np.nonzero(slots >= 0)
        label = group_samples(
            front_faces, nearness, (projection.left + columns + 0.5, projection.top + rows + 0.5),
            projection.functions, facets, offsets, 1.0 / projection.focal,
        )  # fmt: skip
        return front_faces, label, offsets

    everywhere = np.arange(height * width, dtype=np.int32).reshape(height, width)
    front_faces, label, offsets = grouped(everywhere, height * width, samples)
    uneven = unevenly_seen(label, (height, width)).ravel()
    even = np.flatnonzero((label[:, 0] >= 0) & ~uneven)
    again = np.flatnonzero(uneven)
    slots = np.full(height * width, -1, dtype=np.int32)
    slots[again] = np.arange(len(again), dtype=np.int32)
    finer_faces, finer_label, finer_offsets = grouped(
        slots.reshape(height, width), len(again), samples_uneven
    )
    covered = np.count_nonzero(finer_label >= 0, axis=1)
    covered_pixels = np.flatnonzero(covered)
    pixel = np.concatenate([even, again[covered_pixels]])
    slots[:] = -1
    slots[pixel] = np.arange(len(pixel), dtype=np.int32)
    rows, columns = np.divmod(pixel, max(width, 1))
    coverage = np.concatenate([np.ones(len(even)), covered[covered_pixels] / samples_uneven])
    slots = slots.reshape(height, width)
    return View(
        projection,
        slots,
        projection.left + columns + 0.5,
        projection.top + rows + 0.5,
        coverage,
        _finer_coverage(projection, slots, coverage, samples_outline)
        if samples_outline > samples_uneven
        else coverage,
        (
            Samples(0, front_faces[even], label[even], offsets),
            Samples(len(even), finer_faces[covered_pixels], finer_label[covered_pixels], finer_offsets),
        ),
    )


def _finer_coverage(
    projection: Projection, slots: np.ndarray, coverage: np.ndarray, samples: int
) -> np.ndarray:
    """Return the coverage (p,) of pixels, found anew at outlines; of `slots` and `coverage` see `View`."""
    offsets = np.ascontiguousarray((sub_ray_offsets(samples) - 0.5).astype(np.float32).T)
    finer, outline = coverage.copy(), np.flatnonzero(coverage < 1)
    for pixels in np.split(outline, range(OUTLINE_AT_ONCE, len(outline), OUTLINE_AT_ONCE)):
        rank = np.full(len(coverage) + 1, -1, dtype=np.int32)  # the last is that of no pixel
        rank[pixels] = np.arange(len(pixels))
        front_faces, _ = projection.sample(rank[slots], len(pixels), offsets)
        finer[pixels] = np.count_nonzero(front_faces >= 0, axis=1) / samples
    return finer
