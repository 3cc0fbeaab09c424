"""The size of an object: its longest side in metres, stated or as in the file, checked for slips of unit."""

import math
from dataclasses import replace

from objectfolder.errors import InputError
from objectfolder.mesh.mesh import TexturedMesh

SHORTEST_M = 0.003
"""A touch sensor's gel is 16 mm wide and a scan's noise 0.3 mm: nothing below this can be simulated."""

LONGEST_M = 30.0
"""Longest side that may be stated; a ship of 24 m is accepted."""

LONGEST_AS_IN_FILE_M = 5.0
"""Longest side that a file's own units may give; furniture is below 3 m, and larger is mostly millimetres."""

UNUSUAL_M = 3.0
"""Objects above this are accepted with a warning."""


def with_length(mesh: TexturedMesh, length_m: float | None, where: str) -> tuple[TexturedMesh, list[str]]:
    """Scale a mesh so that the longest side of its bounding box is `length_m`; None keeps the file's metres.

    Returns
    -------
    mesh
        Scaled about the origin of the object frame.
    warnings
        One sentence for an unusual size.

    Raises
    ------
    InputError
        A length that is no positive number, a box without extent, or a size that a wrong unit would explain.
    """
    extent = float(mesh.extents.max())
    if not extent > 0:
        raise InputError(where, "all vertices are at one point", "Repair the mesh")
    if length_m is None:
        _refuse_absurd(extent, LONGEST_AS_IN_FILE_M, f"{where}, field length_m", "as in the file")
        return mesh, _warnings(extent)
    check_stated_length(length_m, where)
    if length_m > UNUSUAL_M and math.isclose(length_m, 1000 * extent, rel_tol=0.02):
        raise InputError(
            f"{where}, field length_m",
            f"the stated length {length_m:g} m is 1000 times the {extent:g} m of the mesh",
            f"It is in metres: for {length_m:g} mm write {length_m / 1000:g}, or 'as in file'",
        )
    return replace(mesh, vertices=mesh.vertices * (length_m / extent)), _warnings(length_m)


def check_stated_length(length_m: float, where: str) -> None:
    """Raise `InputError` for a stated length that no object of this kind can have."""
    if not math.isfinite(length_m) or length_m <= 0:
        raise InputError(
            f"{where}, field length_m",
            f"{length_m:g} is not a length",
            "Give the longest side in metres, above 0, or 'as in file'",
        )
    _refuse_absurd(length_m, LONGEST_M, f"{where}, field length_m", "as stated")


def _refuse_absurd(length_m: float, longest_m: float, where: str, origin: str) -> None:
    if length_m > longest_m:
        large = f"; if it really is {length_m:g} m long, state that" if length_m <= LONGEST_M else ""
        raise InputError(
            where,
            f"the longest side, {origin}, is {length_m:g} m, more than {longest_m:g} m",
            f"Were millimetres taken for metres? Then write {length_m / 1000:g}{large}",
        )
    if length_m < SHORTEST_M:
        raise InputError(
            where,
            f"the longest side, {origin}, is {length_m:g} m, less than {1000 * SHORTEST_M:g} mm",
            "Is it in another unit? State the longest side in metres",
        )


def _warnings(length_m: float) -> list[str]:
    if length_m <= UNUSUAL_M:
        return []
    return [f"the longest side is {length_m:g} m, unusual for an object to be held"]
