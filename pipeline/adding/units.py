"""The unit of a mesh whose file does not say it: guessed, and said, never taken for granted."""

from collections.abc import Iterable

from objectfolder.errors import InputError

UNITS_M = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254}
PLAUSIBLE_M = (0.01, 2.5)
"""Longest sides of things that are held, struck and looked at."""

NORMALISED = (1.0, 2.0)


def possible_lengths(side: float) -> dict[str, float]:
    """Longest side in metres by the unit that a number could be in, of those that make it plausible."""
    least, most = PLAUSIBLE_M
    return {name: side * unit for name, unit in UNITS_M.items() if least <= side * unit <= most}


def unit_problem(where: str, side: float) -> InputError:
    """Say why a longest side cannot be in metres, and what to write for each unit it may be in."""
    lengths = possible_lengths(side)
    if lengths:
        told = "; ".join(f"if it is in {name}: --length {length:.6g}" for name, length in lengths.items())
        remedy = told[0].upper() + told[1:]
    else:
        remedy = "State the longest side in metres with --length"
    return InputError(where, f"its longest side is {side:.6g}, which is no size in metres", remedy)


def length_doubts(side: float) -> Iterable[str]:
    """Sentences about a longest side that was taken to be in metres."""
    if any(abs(side - number) <= 1e-6 * number for number in NORMALISED):
        yield f"its longest side is exactly {side:.0f}: was the mesh normalised? State --length if so"
