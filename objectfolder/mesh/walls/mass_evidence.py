"""The mass of an object as scanned, against its published one, and the shell that would have that."""

from objectfolder.mesh.walls.wall_measures import WallMeasures

MASS_FACTOR = 1.5
"""Scans are off by their noise on both sides of a wall, and a class of materials by a tenth or two."""

MASS_UNCERTAINTY = 0.15
"""Relative, of a density that stands for a class of materials."""


def shell_of_mass(volume_m3: float, area_m2: float, solid_mass_kg: float, mass_kg: float) -> float:
    """Thickness in metres of the shell, closed everywhere, that leaves a solid of a mass with another.

    As if the cavity were the outside scaled about the middle, which is exact for balls, cubes and all bodies
    around a ball: with r = 3 V / A, ``t = r (1 - (1 - m / M)^(1/3))``.
    """
    share = min(max(mass_kg / solid_mass_kg, 0.0), 1.0)
    return 3 * volume_m3 / area_m2 * (1 - (1 - share) ** (1 / 3))


class MassEvidence:
    """The mass of the scan as a solid against the published one.

    Parameters
    ----------
    measures
        Of the surface.
    density, mass
        kg/m3 and kg; None where not known: then this says nothing.

    Attributes
    ----------
    ratio
        Mass as scanned over the published one.
    fitting_density
        kg/m3 that would give the published mass.
    shell_m, shell_uncertainty_m
        The shell that would, and how far it may be off: by the density, and by the shape (see
        `shell_of_mass`). None where the scan is not heavier.
    """

    def __init__(self, measures: WallMeasures, density: float | None, mass: float | None) -> None:
        known = density is not None and mass is not None and mass > 0 and measures.volume_m3 > 0
        self.solid_kg = measures.volume_m3 * density if known and density is not None else None
        self.kg = mass if known else None
        self.ratio = self.solid_kg / self.kg if self.solid_kg is not None and self.kg is not None else None
        self.fitting_density = (self.kg or 0.0) / measures.volume_m3 if known else None
        self.shell_m = self.shell_uncertainty_m = None
        if self.ratio is not None and self.ratio > 1 and self.solid_kg is not None and self.kg is not None:
            shells = [
                shell_of_mass(measures.volume_m3, measures.area_m2, self.solid_kg, self.kg * factor)
                for factor in (1.0, 1 - MASS_UNCERTAINTY, 1 + MASS_UNCERTAINTY)
            ]
            # A shell so thin that neither edges nor curvature count: the other extreme of shapes.
            thin = self.kg / (self.solid_kg / measures.volume_m3) / measures.area_m2
            self.shell_m = shells[0]
            self.shell_uncertainty_m = max(abs(shells[2] - shells[1]) / 2, abs(shells[0] - thin))

    @property
    def too_heavy(self) -> bool:
        """Whether the scan is heavier than noise and class of material explain."""
        return self.ratio is not None and self.ratio > MASS_FACTOR

    @property
    def too_light(self) -> bool:
        """Whether it is lighter."""
        return self.ratio is not None and self.ratio < 1 / MASS_FACTOR

    @property
    def agrees(self) -> bool:
        """Whether it is known, and neither."""
        return self.ratio is not None and not (self.too_heavy or self.too_light)

    def numbers(self) -> dict[str, float]:
        """Both masses by name."""
        if self.kg is None or self.solid_kg is None:
            return {}
        return {"published_mass_kg": self.kg, "solid_mass_kg": self.solid_kg}

    def sentence(self) -> str:
        """Say both masses."""
        return f"as scanned it has {in_kilograms(self.solid_kg)}, published are {in_kilograms(self.kg)}"


def millimetres(metres: float) -> str:
    """Write a length for people: two digits, whole above a centimetre."""
    return f"{1e3 * metres:.2g} mm" if metres < 0.01 else f"{1e3 * metres:.0f} mm"


def in_kilograms(mass_kg: float | None) -> str:
    """Write a mass for people, small ones in grams."""
    if mass_kg is None:
        return "an unknown mass"
    return f"{mass_kg:.2g} kg" if mass_kg >= 1 else f"{1e3 * mass_kg:.3g} g"
