"""Walls that cannot be the object's: containers scanned solid, walls of one layer, too thin, torn.

Geometry alone cannot tell an apple from a can. What is known beside it is weighed: the published mass, what
walls of the material are like, the shape, the name. Each finding says which evidence it has; nothing is
changed by it.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from objectfolder.mesh.walls.container_shape import ContainerShape
from objectfolder.mesh.walls.mass_evidence import MassEvidence, millimetres
from objectfolder.mesh.walls.wall_measures import WallMeasures
from objectfolder.mesh.walls.walls_of_materials import WallLimits, limits_of

CERTAIN, LIKELY, POSSIBLE = "certain", "likely", "possible"

SCANNED_SOLID = "scanned solid"
FILLED_BELOW = "filled below"
ONE_LAYER = "one layer"
THIN = "thin"
TORN = "torn"
HEAVIER = "heavier"
LIGHTER = "lighter"
KINDS = (SCANNED_SOLID, FILLED_BELOW, ONE_LAYER, THIN, TORN, HEAVIER, LIGHTER)

COMPACT = 0.55
"""Least share of its convex hull that a container fills, handle and spout included, when it is solid."""

WALLED = 0.15
"""Share of the area that is wall from which an object counts as having walls."""

ALL_WALLS = 0.6
BULK_OF_WALLS, BULK_OF_HEAVY_WALLS = 8.0, 3.5
"""Times its usual wall: a part of a vessel thicker than that is filled; the second where the mass says so,
too. Handles and knobs of mugs and pots that are right have 2 to 3 times, of thin teapots 6."""

FINE = 1 / 100
"""Of the longest side: shells that are thinner were not always resolved by the solver's mesh."""

THIN_SHARE = 0.08
TORN_SHARE = 0.01
DEEP_SHARE = 0.3
"""Of the area, from which the other side is too far inwards for a solid."""

CONTAINER_WORDS = frozenset(
    (
        "bottle",
        "box",
        "can",
        "canister",
        "carton",
        "case",
        "flask",
        "jar",
        "kettle",
        "pot",
        "teapot",
        "tin",
        "tub",
    )
)
VESSEL_WORDS = frozenset(
    ("bowl", "cup", "jug", "mug", "pail", "pan", "pitcher", "planter", "ramekin", "tumbler", "vase")
)


@dataclass(frozen=True)
class WallFinding:
    """Something about an object's walls that its owner should decide.

    Parameters
    ----------
    kind
        One of `KINDS`.
    certainty
        ``"certain"``: what is known contradicts the scan; ``"likely"``; ``"possible"``: a hint.
    finding, remedy
        Sentences.
    evidence
        Numbers it was decided by, their units in their names.
    column
        Of the table of objects, that mends it: ``"wall_m"``, ``"shell_m"``, or None where none does.
    suggested_m, uncertainty_m
        A value for that column, and by how much it may be off; None where nothing tells.
    """

    kind: str
    certainty: str
    finding: str
    remedy: str
    evidence: Mapping[str, float] = field(default_factory=dict)
    column: str | None = None
    suggested_m: float | None = None
    uncertainty_m: float | None = None

    def __str__(self) -> str:
        return f"{self.kind} ({self.certainty}): {self.finding}. {self.remedy}"


def wall_findings(
    measures: WallMeasures,
    *,
    material: str | None = None,
    density_kg_m3: float | None = None,
    mass_kg: float | None = None,
    words: str = "",
    wall_m: float | None = None,
    shell_m: float | None = None,
) -> tuple[WallFinding, ...]:
    """Weigh what is known of an object's walls.

    Parameters
    ----------
    measures
        Of the cleaned surface (see `wall_measures.measures_of`).
    material, density_kg_m3
        Name in the table of materials, and density; None where not known.
    mass_kg
        As published; None where not known. Used with a density only.
    words
        Id and name of the object: hints.
    wall_m, shell_m
        What the table states already: findings that it answers are left out.

    Returns
    -------
    tuple
        At most one finding of each kind, the surest first.
    """
    limits = limits_of(material)
    mass = MassEvidence(measures, density_kg_m3, mass_kg)
    found = []
    if shell_m is None and wall_m is None:
        found += [_hollow_in_truth(measures, limits, material, mass, _words(words))]
    if wall_m is None and shell_m is None:
        found += [_thin(measures, limits, material)]
    found += [_torn(measures)]
    if shell_m is None and wall_m is None and not any(finding for finding in found if finding):
        found += [_mass_alone(measures, mass)]
    certainties = (CERTAIN, LIKELY, POSSIBLE)
    return tuple(
        sorted(filter(None, found), key=lambda finding: certainties.index(finding.certainty)),
    )


def _hollow_in_truth(
    measures: WallMeasures,
    limits: WallLimits,
    material: str | None,
    mass: MassEvidence,
    words: frozenset[str],
) -> WallFinding | None:
    """A container scanned solid, a vessel filled from below, a housing of one layer; or None."""
    too_thick = measures.bulk_m > limits.largest_solid_m
    too_heavy = mass.too_heavy
    compact = measures.filled_share is None or measures.filled_share >= COMPACT
    if not measures.closed:
        deep = measures.thicker_than(limits.largest_solid_m)
        return _one_layer(measures, limits, material, deep) if too_thick and deep >= DEEP_SHARE else None
    named = words & (CONTAINER_WORDS | VESSEL_WORDS)
    if words & VESSEL_WORDS:
        filled = _filled_below(measures, limits, mass, words & VESSEL_WORDS, too_thick=too_thick)
        if filled is not None:
            return filled
    shape = measures.shape.kind if measures.shape is not None and limits.makes_containers else "none"
    shaped = shape != "none" and compact
    hinted = bool(named) and compact and limits.makes_containers
    if measures.cavities and not (too_heavy and too_thick):
        return None
    if not (too_thick or shaped or hinted):
        return None
    evidence = {"bulk_m": measures.bulk_m, "effective_m": measures.effective_m, **mass.numbers()}
    reasons = [f"closed, without a cavity, up to {millimetres(measures.bulk_m)} thick"]
    if too_heavy:
        reasons.append(mass.sentence())
    if too_thick:
        reasons.append(
            f"{material or 'hardly anything'} is seldom solid above {millimetres(limits.largest_solid_m)}"
        )
    if shaped and measures.shape is not None:
        reasons.append(_shape_sentence(measures.shape))
    if hinted:
        reasons.append(f"its name says {', '.join(sorted(named))}")
    if too_heavy:
        certainty = CERTAIN
    elif (too_thick and limits.seldom_solid) or (shaped + hinted + too_thick) >= 2:
        certainty = LIKELY
    elif mass.agrees:
        return None
    else:
        certainty = POSSIBLE
    suggested, off, how = _shell(measures, limits, mass, container=shaped or hinted)
    return WallFinding(
        SCANNED_SOLID,
        certainty,
        "; ".join(reasons),
        f"If it is hollow, set shell_m to its wall{how}{_how_fine(measures, suggested)}; "
        "if it is solid, leave it so",
        evidence,
        "shell_m",
        suggested,
        off,
    )


def _shell(
    measures: WallMeasures, limits: WallLimits, mass: MassEvidence, *, container: bool
) -> tuple[float | None, float | None, str]:
    """A value for shell_m, how far it may be off, and where it is from."""
    usual, wall = limits.container_wall_m, measures.usual_wall_m()
    if wall is not None and measures.wall_share >= ALL_WALLS:
        return wall, wall / 3, f" ({millimetres(wall)} is the median of its walls)"
    if mass.shell_m is None or mass.shell_uncertainty_m is None:
        return usual, usual / 2, f" (about {millimetres(usual)} is usual)"
    if container and mass.shell_m > 1.5 * usual:
        by_mass = f"the mass gives {millimetres(mass.shell_m)}, should it be without contents"
        return usual, usual / 2, f" (about {millimetres(usual)} is usual; {by_mass})"
    how = (
        f" ({millimetres(mass.shell_m)} +- {millimetres(mass.shell_uncertainty_m)} gives the published mass)"
    )
    return mass.shell_m, mass.shell_uncertainty_m, how


def _how_fine(measures: WallMeasures, shell_m: float | None) -> str:
    """Say where a shell is so thin that the volume mesh may not hold it."""
    longest = max(measures.extents_m)
    if shell_m is None or shell_m >= FINE * longest:
        return ""
    return (
        f" (at 1/{longest / shell_m:.0f} of its length it may not be resolved: volume_error of the modes "
        "says so; take a thicker one then)"
    )


def _filled_below(
    measures: WallMeasures, limits: WallLimits, mass: MassEvidence, named: frozenset[str], *, too_thick: bool
) -> WallFinding | None:
    """A vessel by its name, with walls, and a part far thicker than they are; or None."""
    wall = measures.usual_wall_m()
    factor = BULK_OF_HEAVY_WALLS if mass.too_heavy else BULK_OF_WALLS
    if wall is None or measures.wall_share < WALLED:
        return None
    if measures.bulk_m <= max(factor * wall, limits.usual_wall_m):
        return None
    reasons = [
        f"{100 * measures.wall_share:.0f} % of its area is wall of {millimetres(wall)}, "
        f"and yet it is up to {millimetres(measures.bulk_m)} thick"
    ]
    if mass.too_heavy:
        reasons.append(mass.sentence())
    reasons.append(f"its name says {', '.join(sorted(named))}")
    return WallFinding(
        FILLED_BELOW,
        CERTAIN if mass.too_heavy else LIKELY if too_thick else POSSIBLE,
        "; ".join(reasons) + ": the scan did not reach all of its inside",
        f"Set shell_m to its wall (about {millimetres(wall)} where it was scanned): what is filled becomes "
        "a closed hollow",
        {"wall_share": measures.wall_share, "wall_m": wall, "bulk_m": measures.bulk_m, **mass.numbers()},
        "shell_m",
        wall,
        max(wall / 3, limits.least_wall_m),
    )


def _one_layer(measures: WallMeasures, limits: WallLimits, material: str | None, deep: float) -> WallFinding:
    return WallFinding(
        ONE_LAYER,
        LIKELY,
        f"the surface is open ({measures.boundary_edges} boundary edges), and from {100 * deep:.0f} % of it "
        f"the other side is more than {millimetres(limits.largest_solid_m)} inwards: walls of one layer "
        f"around an empty inside, which sounds as if it were solid {material or ''}".rstrip(),
        f"Set shell_m to the thickness of its walls (about {millimetres(limits.usual_wall_m)} is usual)"
        + _how_fine(measures, limits.usual_wall_m),
        {
            "boundary_edges": float(measures.boundary_edges),
            "deep_share": deep,
            "bulk_m": measures.bulk_m,
            "volume_m3": measures.volume_m3,
        },
        "shell_m",
        limits.usual_wall_m,
        limits.usual_wall_m / 2,
    )


def _thin(measures: WallMeasures, limits: WallLimits, material: str | None) -> WallFinding | None:
    share = measures.walls_thinner_than(limits.least_wall_m)
    wall = measures.usual_wall_m()
    if wall is None or share < THIN_SHARE:
        return None
    mostly = wall < limits.least_wall_m
    suggested = limits.usual_wall_m if mostly else wall
    walls = f"walls of {material}" if material else "any walls that a scanner resolves"
    return WallFinding(
        THIN,
        LIKELY if material else POSSIBLE,
        f"{100 * share:.0f} % of its area is wall thinner than {millimetres(limits.least_wall_m)}, which "
        f"{walls} are hardly; the median wall has {millimetres(wall)}, "
        f"the solid 2V/A = {millimetres(measures.effective_m)}",
        f"Set wall_m to what its walls have at least ({millimetres(suggested)} "
        + ("is usual)" if mostly else "is the median of this scan)"),
        {"thin_share": share, "wall_m": wall, "effective_m": measures.effective_m},
        "wall_m",
        suggested,
        suggested / 3,
    )


def _torn(measures: WallMeasures) -> WallFinding | None:
    if measures.torn_share < TORN_SHARE:
        return None
    wall = measures.usual_wall_m()
    return WallFinding(
        TORN,
        CERTAIN,
        f"behind {100 * measures.torn_share:.0f} % of its area there is no inside: the two sides of a wall "
        "have passed through one another",
        "Set wall_m to what its walls have at least"
        + (f" (the median is {millimetres(wall)})" if wall else ""),
        {"torn_share": measures.torn_share},
        "wall_m",
        wall,
        None if wall is None else wall / 3,
    )


def _mass_alone(measures: WallMeasures, mass: MassEvidence) -> WallFinding | None:
    """A mass that contradicts a scan of ordinary thickness; or None."""
    if mass.fitting_density is None or not (mass.too_heavy or mass.too_light):
        return None
    numbers = {**mass.numbers(), "fitting_density_kg_m3": mass.fitting_density}
    fits = f"the material fits a density of {mass.fitting_density:.0f} kg/m3"
    if mass.too_heavy:
        walls = measures.wall_share >= ALL_WALLS
        why = "its walls are scanned too thick" if walls else "it is hollow, scanned too thick"
        return WallFinding(
            HEAVIER,
            CERTAIN,
            f"{mass.sentence()}: {why}, or of something lighter ({fits})",
            "Correct the material or the mesh; a hollow part takes shell_m",
            numbers,
        )
    return WallFinding(
        LIGHTER,
        CERTAIN,
        f"{mass.sentence()}: parts of it are missing from the scan or too thin, or it is of something "
        f"heavier ({fits})",
        "Correct the material or the mesh; walls that are too thin take wall_m",
        numbers,
    )


def _shape_sentence(shape: ContainerShape) -> str:
    tail = "a lid" if shape.kind == "can" else f"a neck over {100 * shape.neck:.0f} % of the height"
    return (
        f"shaped like a {shape.kind}: a flat base, even sections over {100 * shape.body:.0f} % of the "
        f"height, {tail}, roundness {shape.roundness:.2f}"
    )


def _words(text: str) -> frozenset[str]:
    """Words of ids and names in small letters: parts at capitals, digits and signs."""
    apart = re.sub(r"([a-z])([A-Z])", r"\1 \2", text)
    words = re.findall(r"[a-z]+", apart.lower())
    return frozenset(words) | frozenset(word.removesuffix("s") for word in words)
