"""The unit of a mesh whose file does not name it: assumed to be metres, checked, and printed."""

from collections.abc import Iterable

from objectfolder.errors import InputError
from objectfolder.mesh.length import LONGEST_M, SHORTEST_M, UNUSUAL_M

UNITS_M = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254}
PLAUSIBLE_M = (0.01, 2.5)
"""Longest sides of things that are held, struck and looked at."""

NORMALISED = (1.0, 2.0)
HEAVIEST_KG = 500.0


def possible_lengths(side: float) -> dict[str, float]:
    """Longest side in metres by the unit that a number could be in, of those that make it plausible."""
    least, most = PLAUSIBLE_M
    return {name: side * unit for name, unit in UNITS_M.items() if least <= side * unit <= most}


def check_unit(where: str, side: float) -> None:
    """Raise `InputError` for a longest side that is hardly in metres, with what to write for each unit."""
    if SHORTEST_M <= side <= UNUSUAL_M:
        return
    lengths = possible_lengths(side) if side >= SHORTEST_M else {}
    remedy = "; ".join(f"if it is in {name}: --length {length:.6g}" for name, length in lengths.items())
    remedy = remedy[:1].upper() + remedy[1:] or "State the longest side in metres with --length"
    if side <= LONGEST_M:
        remedy += f"; if it really is {side:.6g} m long: --length {side:.6g}"
    finding = f"its longest side is {side:.6g}, which is hardly in metres, and no unit is stated"
    raise InputError(where, finding, remedy)


def length_doubts(side: float, mass_kg: float) -> Iterable[str]:
    """Sentences about a longest side that was taken to be in metres, and the mass that follows from it."""
    if mass_kg > HEAVIEST_KG:
        lengths = possible_lengths(side)
        units = "; ".join(f"in {name} it is --length {length:.6g}" for name, length in lengths.items())
        yield f"it would have {mass_kg:.0f} kg: is it in metres?" + (f" If {units}" if units else "")
    if any(abs(side - number) <= 1e-6 * number for number in NORMALISED):
        yield f"its longest side is exactly {side:.0f}: was the mesh normalised? State --length if so"
