"""How thick walls and solid parts of each material are made: what a scan's walls are held against.

Limits of ordinary household things, in metres, wide on purpose: what is outside is asked about, never
changed. Moulded plastics have walls of 0.6 to 5 mm, for thicker ones sink and take minutes to cool
(moulders' design guides give 0.6 to 3.8 mm for ABS, polycarbonate and polypropylene); tinplate of cans is
0.14 to 0.3 mm (tables of its makers); tableware is slip cast or pressed at 2 to 8 mm, and clay thicker than
an inch is made hollow, for it cracks in drying and firing.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class WallLimits:
    """Thicknesses in metres.

    Parameters
    ----------
    least_wall_m
        Walls of things that are handled are not thinner.
    usual_wall_m
        Of an open vessel or a housing.
    container_wall_m
        Of a closed container: can, bottle, box, pot with its lid.
    largest_solid_m
        What is thicker is rarely solid.
    seldom_solid
        Whether that is so firm a rule that breaking it is likely a fault of the scan; toys and tools of
        plastic are solid now and then.
    makes_containers
        Whether a shape like a can's or a bottle's tells of a container.
    """

    least_wall_m: float
    usual_wall_m: float
    container_wall_m: float
    largest_solid_m: float
    seldom_solid: bool
    makes_containers: bool = True


WALL_LIMITS = {
    "ceramic": WallLimits(0.0015, 0.004, 0.004, 0.025, True),
    "glass": WallLimits(0.0008, 0.0025, 0.003, 0.05, True),
    "plastic": WallLimits(0.0005, 0.002, 0.001, 0.025, False),
    "polycarbonate": WallLimits(0.0005, 0.002, 0.001, 0.025, False),
    "steel": WallLimits(0.00014, 0.0008, 0.00025, 0.05, True),
    "iron": WallLimits(0.0003, 0.003, 0.002, 0.06, True),
    "wood": WallLimits(0.0015, 0.008, 0.006, 0.25, False, makes_containers=False),
}
"""By name of a material of the material table."""

ANY_MATERIAL = WallLimits(0.0003, 0.003, 0.003, 0.1, False)
"""For a material that is not known, or not in the table: 0.3 mm is the noise of a good scan."""


def limits_of(material: str | None) -> WallLimits:
    """Return the limits of a material by its name; wide ones for another, or None."""
    return WALL_LIMITS.get(material or "", ANY_MATERIAL)
