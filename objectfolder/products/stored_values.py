"""Values that an Object File stores, checked when it is opened: strangers write such files, too."""

import math
import reprlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.tensor_file import REMEDY

LARGEST_KG = 1e9
LARGEST_FIGURE = 1e12
# Figures of fidelity that are told of every file; those of sound, where there is any.
FIGURES = {
    "vision": ("psnr_db", "psnr_foreground_db", "ssim", "held_out_views"),
    "audio": ("gain_error_db", "frequency_error_cents"),
    "touch": ("psnr_db", "held_out_touches", "unreachable_share"),
}


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
    if _fields("body", body)["filled_mass_kg"] is not None:
        number("body.filled_mass_kg", body["filled_mass_kg"], 1 / LARGEST_KG, LARGEST_KG)
    for solid in ("", "filled_"):
        if body.get(f"{solid}inertia_kg_m2") is not None:
            number(f"body.{solid}mass_kg", body[f"{solid}mass_kg"], 1 / LARGEST_KG, LARGEST_KG)
            for name, shape in (("centre_of_mass_m", (3,)), ("inertia_kg_m2", (3, 3))):
                numbers(f"body.{solid}{name}", body[f"{solid}{name}"], shape, LARGEST_KG)


def check_material(material: Any) -> None:
    """Check what sound asks of the description ``material``, which is None where it is not known.

    Raises
    ------
    FormatError
        Elasticity or roughness that no material has.
    """
    if material is not None:
        fields = _fields("material", material)
        number("material.youngs_modulus_pa", fields["youngs_modulus_pa"], 1.0, 1e15)
        number("material.poisson_ratio", fields["poisson_ratio"], -1.0, 0.5)
        if fields.get("roughness_um") is not None:
            number("material.roughness_um", fields["roughness_um"], 0.0, 1e6)


def check_words(described: Any) -> None:
    """Check the description ``object``: texts by name, and perhaps a measured mass.

    Raises
    ------
    FormatError
        No id, something that is no text, or a mass that no body has.
    """
    fields = _fields("object", described)
    if fields.get("mass_kg") is not None:
        number("object.mass_kg", fields["mass_kg"], 1 / LARGEST_KG, LARGEST_KG)
    for name in {"id", *fields} - {"mass_kg"}:
        if not isinstance(fields.get(name), str | None) or (name == "id" and not fields.get(name)):
            raise FormatError(f"object.{name}", f"{reprlib.repr(fields.get(name))} is no text", REMEDY)


def check_fidelity(fidelity: Any) -> None:
    """Check the description ``fidelity``, which is None where it was not measured.

    Raises
    ------
    FormatError
        Figures that are missing, or no numbers.
    """
    if fidelity is None:
        return
    for sense, names in FIGURES.items():
        figures = _fields(f"fidelity.{sense}", _fields("fidelity", fidelity).get(sense))
        needed = () if sense == "audio" and not figures.get("audible") else names
        for name in needed:
            value = figures.get(name)
            # Not a number where nothing could be compared, as of an object thinner than every pixel.
            if not (isinstance(value, float) and math.isnan(value)):
                number(f"fidelity.{sense}.{name}", value, -LARGEST_FIGURE, LARGEST_FIGURE)


def _fields(where: str, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise FormatError(where, f"{reprlib.repr(value)} holds no fields", REMEDY)
    return value
