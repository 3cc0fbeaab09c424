"""How thick the walls of an object are, by two measures."""

from dataclasses import asdict, dataclass

import numpy as np

from objectfolder.surface.surface import Surface


@dataclass(frozen=True)
class WallThickness:
    """Wall thickness in metres; None where the surface does not tell.

    Parameters
    ----------
    effective_m
        2 V / A: the thickness of a thin plate of the same volume and area; only for a closed surface. A ball
        of radius r has 2 r / 3.
    median_m, thin_m
        Median and 5 % quantile over the area of the distance from a point inwards along the normal to the
        other side.
    """

    effective_m: float | None
    median_m: float | None
    thin_m: float | None

    def to_dict(self) -> dict[str, float | None]:
        """Return the measures by name."""
        return asdict(self)


def wall_thickness(
    surface: Surface, volume_m3: float | None, *, rays: int = 2048, seed: int = 0
) -> WallThickness:
    """Measure the walls of a surface with outward faces.

    Parameters
    ----------
    volume_m3
        Of the enclosed solid; None for an open surface.
    rays
        Points drawn uniformly by area, one ray inwards each.
    """
    samples = surface.sample(rays, seed)
    normals = surface.face_normals[samples.face]
    start = 1e-6 * float(np.ptp(surface.bounds, axis=0).max())
    hits = surface.ray_hits(samples.points - start * normals, -normals)
    thickness = start + hits.distance[np.isfinite(hits.distance)]
    effective = 2 * volume_m3 / surface.area if volume_m3 is not None and volume_m3 > 0 else None
    if len(thickness) == 0:
        return WallThickness(effective, None, None)
    thin, median = np.quantile(thickness, [0.05, 0.5])
    return WallThickness(effective, float(median), float(thin))
