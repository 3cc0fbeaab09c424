"""The data sheet of an Object File: what its page says of the object in a screen."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from objectfolder.making.materials import Material
from objectfolder.object_file import ObjectFile
from pipeline.dataset.counts import counted
from pipeline.dataset.measures import HEADLINE, number_at
from pipeline.publish.report.templates import TIMES, digits, number

UNKNOWN = "not stated"
PROPERTIES = (
    ("density_kg_m3", 1.0, "{} kg/m³"),
    ("youngs_modulus_pa", 1e-9, "{} GPa"),
    ("poisson_ratio", 1.0, "Poisson's ratio {}"),
)
CREDITS = ("licence", "attribution", "source")


def data_sheet(file: ObjectFile, materials: Mapping[str, Material]) -> dict[str, str]:
    """Return lines of a data sheet by their headings.

    Parameters
    ----------
    materials
        Table of materials, by name, which has friction and restitution.

    Examples
    --------
    >>> import objectfolder
    >>> data_sheet(objectfolder.load("bar.safetensors"), {})["Size"]
    '120.0 × 30.0 × 8.0 mm'
    """
    record, material = file.description["object"], file.description["material"] or {}
    row = materials.get(str(material.get("name")))
    contact = [(row.friction, "friction"), (row.restitution, "restitution")] if row else []
    sides = f" {TIMES} ".join(number(1e3 * side) for side in np.ptp(file.bounds_m, axis=0))
    return {
        "Size": f"{sides} mm",
        "Mass": UNKNOWN if file.mass_kg is None else mass(file.mass_kg),
        "Material": ", ".join(_material(material)) or UNKNOWN,
        "Contact": ", ".join(f"{name} {digits(value, 2)}" for value, name in contact if value is not None)
        or UNKNOWN,
        "Modes": _modes(file),
        "Fidelity": _fidelity(file) or "not measured",
        **{name.capitalize(): str(record.get(name) or UNKNOWN) for name in CREDITS},
    }


def mass(mass_kg: float) -> str:
    """Return a mass in grams below a kilogram."""
    return f"{digits(1e3 * mass_kg)} g" if mass_kg < 1 else f"{digits(mass_kg)} kg"


def _material(material: Mapping[str, Any]) -> list[str]:
    lines = [str(material["name"])] if material.get("name") else []
    for name, scale, words in PROPERTIES:
        if (value := material.get(name)) is not None:
            lines.append(words.format(digits(scale * value)))
    return lines


def _modes(file: ObjectFile) -> str:
    modes = file.modes
    if not len(modes.eigenvalues):
        return "no sound" if modes.absent else "no audible mode"
    first, last = modes.frequencies_hz[[0, -1]]
    decay_s = math.log(1000) / float(modes.dampings_per_s[0])
    count = counted(len(modes.eigenvalues), "mode")
    return (
        f"{count}, {number(first, 0)} to {number(last, 0)} Hz; "
        f"the first falls by 60 dB in {digits(decay_s)} s"
    )


def _fidelity(file: ObjectFile) -> str:
    values = [(measure, number_at(file.fidelity or {}, measure.key)) for measure in HEADLINE]
    return "; ".join(
        f"{measure.label} {number(value, measure.decimals)} {measure.unit}".strip()
        for measure, value in values
        if value is not None
    )
