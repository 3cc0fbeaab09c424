"""Walls of an object: how thick they are, and which cannot be its own; nothing is changed by a finding.

The limits are those of ordinary household things, wide on purpose. Moulded plastics have walls of 0.6 to
5 mm, for thicker ones sink and take minutes to cool (moulders' design guides give 0.6 to 3.8 mm for ABS,
polycarbonate and polypropylene); tinplate of cans is 0.14 to 0.3 mm (tables of its makers); tableware is slip
cast or pressed at 2 to 8 mm, and clay thicker than an inch is made hollow, for it cracks as it dries.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from objectfolder.surface.openings import LEAST_OPENING, has_cracks_only, opening_shares, patches_of
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import enclosed_volume

WALL_RAYS = 2048
BALLS = 256
THIN_SHARE = 0.1

WALL_SHARE = 1 / 8
"""Of the middle one of an object's three sides: what is thicker is no wall of it."""

FACING_AWAY = -0.5
"""Cosine between the normals of the two sides of a wall: within 60 degrees of opposite."""


@dataclass(frozen=True)
class WallMeasures:
    """Measures of a cleaned surface; lengths in metres, None where no ray meets another side.

    Parameters
    ----------
    closed
        Watertight, wound consistently, around a positive volume.
    longest_m
        Longest side of the bounding box.
    area_m2, volume_m3
        Of an open surface the volume where the winding number is above a half, which is what sounds.
    effective_m
        2 V / A: the thickness of a thin plate of the same volume and area. A ball of radius r has 2 r / 3.
    median_m, thin_m
        Median and 5 % quantile over the area of the distance inwards along the normal to the other side.
    bulk_m
        Diameter of about the largest ball inside: how thick the object is at its thickest.
    wall_share
        Of the area, what is wall: the other side faces away within 60 degrees, at most `WALL_SHARE` of the
        middle side away.
    wall_median_m
        Median thickness of the walls alone.
    wall_thin_m
        `THIN_SHARE` of the whole area is wall thinner than this; None where less is wall.
    opening_share
        Area of the openings of patches that are not mostly wall, over that of the surface; of what sounds
        they are closed.
    cracked
        Closed but for cracks, which have no opening (see `openings.has_cracks_only`).
    """

    closed: bool
    longest_m: float
    area_m2: float
    volume_m3: float
    effective_m: float
    median_m: float | None
    thin_m: float | None
    bulk_m: float
    wall_share: float
    wall_median_m: float | None
    wall_thin_m: float | None
    opening_share: float = 0.0
    cracked: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return the measures as JSON values; `WallMeasures(**values)` takes them."""
        return asdict(self)

    def thickness(self) -> Mapping[str, float | None]:
        """Return `effective_m`, which only a closed surface has, `median_m` and `thin_m` by name."""
        effective = self.effective_m if self.closed else None
        return {"effective_m": effective, "median_m": self.median_m, "thin_m": self.thin_m}


def measure_walls(surface: Surface) -> WallMeasures:
    """Measure a cleaned surface with outward faces, along the normals at `WALL_RAYS` points, drawn by area.

    Examples
    --------
    >>> from trimesh.creation import box
    >>> plate = box((0.2, 0.1, 0.004))
    >>> measures = measure_walls(Surface(plate.vertices, plate.faces))
    >>> round(measures.wall_median_m, 6), round(measures.volume_m3, 6)
    (0.004, 8e-05)
    """
    topology, volume = surface.topology, enclosed_volume(surface, samples=8192)[0]
    closed = topology.watertight and topology.consistent and volume > 0
    extents = np.ptp(surface.bounds, axis=0)
    drawn = surface.sample(WALL_RAYS, 0)
    normals = surface.face_normals[drawn.face]
    start = 1e-6 * float(extents.max())
    hits = surface.ray_hits(drawn.points - start * normals, -normals)
    met = hits.face >= 0
    across = start + hits.distance[met]
    opposite = np.einsum("ij,ij->i", normals[met], surface.face_normals[hits.face[met]])
    is_wall = (opposite < FACING_AWAY) & (across <= WALL_SHARE * np.sort(extents)[1])
    walls = np.sort(across[is_wall])
    thin, median = np.quantile(across, [0.05, 0.5]).tolist() if len(across) else (None, None)
    middles = drawn.points[met] - normals[met] * across[:, None] / 2
    cracked = not closed and has_cracks_only(surface)
    thin_rays = round(THIN_SHARE * WALL_RAYS)
    return WallMeasures(
        closed=closed,
        longest_m=float(extents.max()),
        area_m2=surface.area,
        volume_m3=volume,
        effective_m=2 * volume / surface.area,
        median_m=median,
        thin_m=thin,
        bulk_m=_largest_ball(surface, middles, drawn.points),
        wall_share=len(walls) / WALL_RAYS,
        wall_median_m=float(np.median(walls)) if len(walls) else None,
        wall_thin_m=float(walls[thin_rays]) if len(walls) > thin_rays else None,
        cracked=cracked,
        opening_share=0.0
        if closed or cracked
        else _opening_share(surface, drawn.face, drawn.face[met][is_wall]),
    )


def _opening_share(surface: Surface, drawn: np.ndarray, walled: np.ndarray) -> float:
    """`WallMeasures.opening_share`, by the faces (n,) of points drawn and of those (w,) that are wall."""
    patch = patches_of(surface.edges)
    count = int(patch.max()) + 1
    of_wall, of_all = np.bincount(patch[walled], minlength=count), np.bincount(patch[drawn], minlength=count)
    areas = opening_shares(surface, patch) * np.bincount(patch, surface.face_areas)
    return float(areas[2 * of_wall <= of_all].sum() / surface.area)


def _largest_ball(surface: Surface, middles: np.ndarray, points: np.ndarray) -> float:
    """Diameter of about the largest ball inside at one of (n, 3) `middles`; `points` lie on the surface.

    The nearest of the points bounds each ball from above; distances to the surface are taken at the `BALLS`
    middles of the largest bounds.
    """
    if len(middles) == 0:
        return 0.0
    bound = cdist(middles, points).min(axis=1)
    widest = middles[np.argsort(-bound, kind="stable")[:BALLS]]
    return 2 * float(surface.sampled_distance.nearest(widest)[1].max())


CERTAIN, LIKELY, POSSIBLE = "certain", "likely", "possible"
TOO_THICK, ONE_LAYER, THIN, HEAVIER, LIGHTER = "too thick", "one layer", "thin", "heavier", "lighter"

MASS_FACTOR = 1.5
"""Scans are off by their noise on both sides of a wall, and a class of materials by a tenth or two."""

FINE = 1 / 100
"""Of the longest side: shells that are thinner were not always resolved by the solver's mesh."""


@dataclass(frozen=True)
class WallLimits:
    """Thicknesses in metres.

    Parameters
    ----------
    least_wall_m
        Walls of things that are handled are not thinner.
    usual_wall_m
        Of a vessel or a housing.
    largest_solid_m
        What is thicker is rarely solid.
    seldom_solid
        Whether that is a firm rule; toys and tools of plastic are solid now and then.
    """

    least_wall_m: float
    usual_wall_m: float
    largest_solid_m: float
    seldom_solid: bool


WALL_LIMITS = {
    "ceramic": WallLimits(0.0015, 0.004, 0.025, True),
    "glass": WallLimits(0.0008, 0.0025, 0.05, True),
    "plastic": WallLimits(0.0005, 0.002, 0.025, False),
    "polycarbonate": WallLimits(0.0005, 0.002, 0.025, False),
    "steel": WallLimits(0.00014, 0.0008, 0.05, True),
    "iron": WallLimits(0.0003, 0.003, 0.06, True),
    "wood": WallLimits(0.0015, 0.008, 0.25, False),
}
"""By name of a material of the material table."""

ANY_MATERIAL = WallLimits(0.0003, 0.003, 0.1, False)
"""For a material that is not known, or not in the table: 0.3 mm is the noise of a good scan."""


@dataclass(frozen=True)
class WallFinding:
    """Something about an object's walls that its owner should decide.

    Parameters
    ----------
    kind
        `TOO_THICK`, `ONE_LAYER`, `THIN`, `HEAVIER` or `LIGHTER`.
    certainty
        `CERTAIN`: the mass contradicts the scan; `LIKELY`; `POSSIBLE`: a hint.
    finding, remedy
        Sentences.
    column
        Of the table of objects, that mends it: ``"wall_m"`` or ``"shell_m"``.
    """

    kind: str
    certainty: str
    finding: str
    remedy: str
    column: str

    def __str__(self) -> str:
        return f"{self.kind} ({self.certainty}): {self.finding}. {self.remedy}"


def wall_findings(
    measures: WallMeasures,
    *,
    material: str | None = None,
    density_kg_m3: float | None = None,
    mass_kg: float | None = None,
    wall_m: float | None = None,
    shell_m: float | None = None,
) -> tuple[WallFinding, ...]:
    """Hold the walls and the mass of an object against its material and its published mass.

    Parameters
    ----------
    measures
        Of the cleaned surface (see `measures.measure_walls`).
    material, density_kg_m3
        Name in the table of materials, and density; None where not known.
    mass_kg
        As published; None where not known. Used with a density only.
    wall_m, shell_m
        What the table states: either one answers all findings.

    Returns
    -------
    tuple
        At most one finding about solid parts or the mass, then at most one about thin walls.
    """
    if wall_m is not None or shell_m is not None:
        return ()
    limits = WALL_LIMITS.get(material or "", ANY_MATERIAL)
    weighed = None
    if density_kg_m3 is not None and mass_kg is not None and measures.volume_m3 > 0:
        weighed = measures.volume_m3 * density_kg_m3 / mass_kg
    agrees = weighed is not None and 1 / MASS_FACTOR <= weighed <= MASS_FACTOR
    thickness = None if agrees else _too_thick(measures, limits, material, mass_kg, weighed)
    if thickness is None and weighed is not None and not agrees and mass_kg is not None:
        thickness = _by_mass(measures, mass_kg, weighed)
    return tuple(finding for finding in (thickness, _thin(measures, limits, material)) if finding is not None)


def shell_of_mass(volume_m3: float, area_m2: float, share: float) -> float:
    """Thickness in metres of the shell, closed everywhere, that leaves a solid with a share of its mass.

    As if the cavity were the outside scaled about the middle, which is exact for balls, cubes and all bodies
    around a ball: with r = 3 V / A, ``t = r (1 - (1 - m / M)^(1/3))``.

    Examples
    --------
    >>> round(shell_of_mass(volume_m3=1e-3, area_m2=0.06, share=1 - 0.8**3), 6)
    0.01
    """
    return 3 * volume_m3 / area_m2 * (1 - (1 - share) ** (1 / 3))


def millimetres(metres: float) -> str:
    """Write a length for people: two digits, whole above a centimetre."""
    return f"{1e3 * metres:.2g} mm" if metres < 0.01 else f"{1e3 * metres:.0f} mm"


def _too_thick(
    measures: WallMeasures,
    limits: WallLimits,
    material: str | None,
    mass_kg: float | None,
    weighed: float | None,
) -> WallFinding | None:
    """A container scanned solid, or a housing of one layer of faces; None where neither is."""
    closed = measures.closed or measures.cracked
    thickest = measures.bulk_m if closed else measures.median_m or 0.0
    if thickest <= limits.largest_solid_m:
        filled = measures.opening_share > LEAST_OPENING and measures.volume_m3 > 0
        return _open(measures, limits) if filled else None
    seldom = f"solid {material or 'matter'} above {millimetres(limits.largest_solid_m)} is rare"
    shell_m, how = limits.usual_wall_m, "is usual"
    if weighed is not None and weighed > MASS_FACTOR:
        shell_m, how = _shell_of(measures, weighed), f"gives the published {mass_kg:.3g} kg"
    remedy = f"If it is hollow, set shell_m to its wall ({millimetres(shell_m)} {how})"
    remedy += _how_fine(measures, shell_m)
    if not closed:
        finding = (
            f"the surface is open, and from half of it the other side is more than {millimetres(thickest)} "
            f"inwards: {seldom}"
        )
        return WallFinding(ONE_LAYER, LIKELY, finding, remedy, "shell_m")
    certainty = LIKELY if limits.seldom_solid else POSSIBLE
    return WallFinding(
        TOO_THICK,
        CERTAIN if weighed is not None and weighed > MASS_FACTOR else certainty,
        f"closed, and solid up to {millimetres(thickest)} thick: {seldom}",
        f"{remedy}; if it is solid, leave it so",
        "shell_m",
    )


def _open(measures: WallMeasures, limits: WallLimits) -> WallFinding:
    """A sheet, or a box without a lid, of ordinary size: its sound and mass are those of what fills it."""
    finding = (
        f"the surface is open: its openings make {measures.opening_share:.0%} of its area, and it sounds and "
        "weighs as if it were filled up to them"
    )
    usual = millimetres(limits.usual_wall_m)
    remedy = f"If it is a sheet, set wall_m to its thickness ({usual} is usual); if it is solid, close it"
    return WallFinding(ONE_LAYER, LIKELY, finding, remedy, "wall_m")


def _by_mass(measures: WallMeasures, mass_kg: float, weighed: float) -> WallFinding:
    """A mass that contradicts a scan of ordinary thickness."""
    finding = (
        f"as scanned it has {weighed * mass_kg:.3g} kg, published are {mass_kg:.3g} kg "
        f"({mass_kg / measures.volume_m3:.0f} kg/m3)"
    )
    if weighed < 1:
        remedy = "Parts are missing or too thin (set wall_m), or correct the material or the mesh"
        return WallFinding(LIGHTER, CERTAIN, finding, remedy, "wall_m")
    shell_m = _shell_of(measures, weighed)
    remedy = f"If it is hollow, set shell_m to its wall ({millimetres(shell_m)} gives the published mass"
    if measures.wall_median_m is not None:
        remedy += f"; the median of its walls is {millimetres(measures.wall_median_m)}"
    remedy += f"){_how_fine(measures, shell_m)}; else correct the material or the mesh"
    return WallFinding(HEAVIER, CERTAIN, finding, remedy, "shell_m")


def _thin(measures: WallMeasures, limits: WallLimits, material: str | None) -> WallFinding | None:
    thin, median = measures.wall_thin_m, measures.wall_median_m
    if thin is None or median is None or thin >= limits.least_wall_m:
        return None
    mostly = median < limits.least_wall_m
    suggested = millimetres(limits.usual_wall_m if mostly else median)
    return WallFinding(
        THIN,
        LIKELY if material else POSSIBLE,
        f"{100 * THIN_SHARE:.0f} % of its area is wall of at most {millimetres(thin)}, and walls of "
        f"{material or 'anything'} have at least {millimetres(limits.least_wall_m)}; the median wall has "
        f"{millimetres(median)}",
        f"Set wall_m to what its walls have at least ({suggested} is "
        f"{'usual' if mostly else 'the median of this scan'})",
        "wall_m",
    )


def _shell_of(measures: WallMeasures, weighed: float) -> float:
    return shell_of_mass(measures.volume_m3, measures.area_m2, 1 / weighed)


def _how_fine(measures: WallMeasures, shell_m: float) -> str:
    """Say where a shell is so thin that the volume mesh may not hold it."""
    if shell_m >= FINE * measures.longest_m:
        return ""
    return (
        f" (1/{measures.longest_m / shell_m:.0f} of its length may not be resolved: volume_error of the "
        "modes says so; take a thicker one then)"
    )
