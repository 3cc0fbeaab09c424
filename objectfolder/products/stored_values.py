"""Values that an Object File stores, checked when it is opened: strangers write such files, too."""

import reprlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.tensor_file import REMEDY

LARGEST_KG = 1e9


def number(where: str, value: Any, low: float, high: float) -> float:
    """Return a stored number within `low` to `high`.

    Raises
    ------
    FormatError
        Anything else.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        finding = f"{reprlib.repr(value)} is no number within {low:g} to {high:g}"
        raise FormatError(where, finding, REMEDY)
    return float(value)


def whole_number(where: str, value: Any, low: int, high: int) -> int:
    """Return a stored whole number within `low` to `high`.

    Raises
    ------
    FormatError
        Anything else.
    """
    if number(where, value, low, high) != value or not isinstance(value, int):
        raise FormatError(where, f"{reprlib.repr(value)} is no whole number", REMEDY)
    return value


def numbers(where: str, values: Any, shape: Sequence[int], limit: float) -> np.ndarray:
    """Return stored nested lists of numbers as float64 of `shape`, all within -`limit` to `limit`.

    Raises
    ------
    FormatError
        Anything else.
    """
    if not shape:
        return np.asarray(number(where, values, -limit, limit))
    if not isinstance(values, list | tuple) or len(values) != shape[0]:
        raise FormatError(where, f"{reprlib.repr(values)} is not of shape {tuple(shape)}", REMEDY)
    parts = [numbers(f"{where}.{index}", part, shape[1:], limit) for index, part in enumerate(values)]
    return np.array(parts).reshape(shape)


def check_body(body: Any) -> None:
    """Check what sound asks of the description ``body``, which is None where it is not known.

    Raises
    ------
    FormatError
        Masses, a centre or an inertia that no body has.
    """
    if body is None:
        return
    number("body.filled_mass_kg", _fields("body", body)["filled_mass_kg"], 1 / LARGEST_KG, LARGEST_KG)
    if body["inertia_kg_m2"] is not None:
        number("body.mass_kg", body["mass_kg"], 1 / LARGEST_KG, LARGEST_KG)
        numbers("body.centre_of_mass_m", body["centre_of_mass_m"], (3,), LARGEST_KG)
        numbers("body.inertia_kg_m2", body["inertia_kg_m2"], (3, 3), LARGEST_KG)


def check_material(material: Any) -> None:
    """Check what sound asks of the description ``material``, which is None where it is not known.

    Raises
    ------
    FormatError
        Elasticity that no material has.
    """
    if material is not None:
        fields = _fields("material", material)
        number("material.youngs_modulus_pa", fields["youngs_modulus_pa"], 1.0, 1e15)
        number("material.poisson_ratio", fields["poisson_ratio"], -1.0, 0.5)


def _fields(where: str, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise FormatError(where, f"{reprlib.repr(value)} holds no fields", REMEDY)
    return value
