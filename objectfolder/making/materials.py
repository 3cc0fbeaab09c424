"""Materials: elasticity, density, damping and plain looks, read from a table."""

import csv
import difflib
import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from objectfolder.products.regular_file import require_regular


@dataclass(frozen=True)
class Material:
    """An isotropic elastic material, and how it loses energy.

    Attributes
    ----------
    name : lower case
    density_kg_m3, youngs_modulus_pa : positive
    poisson_ratio : in (-1, 0.5)
    rayleigh_alpha_per_s, rayleigh_beta_s : damping matrix alpha M + beta K, not negative; None where the
        table states a loss factor alone
    roughness, metallic : defaults of the looks, in [0, 1]
    citation : where the numbers come from
    friction, restitution, roughness_um, contact_citation : dry contact, sliding friction not negative,
        restitution in [0, 1], root mean square of the heights of a surface (micrometres), and where they
        come from; None and empty where the table does not say
    loss_factor, loss_exponent, loss_citation : eta = loss_factor (f / 1 kHz)^loss_exponent, and where it
        comes from; None where the table states Rayleigh's coefficients alone
    """

    name: str
    density_kg_m3: float
    youngs_modulus_pa: float
    poisson_ratio: float
    rayleigh_alpha_per_s: float | None
    rayleigh_beta_s: float | None
    roughness: float
    metallic: float
    citation: str
    friction: float | None = None
    restitution: float | None = None
    roughness_um: float | None = None
    contact_citation: str = ""
    loss_factor: float | None = None
    loss_exponent: float = 0.0
    loss_citation: str = ""

    @property
    def shear_speed_m_s(self) -> float:
        """Speed of shear waves sqrt(mu / rho), mu = E / (2 (1 + nu))."""
        return math.sqrt(self.youngs_modulus_pa / (2 * (1 + self.poisson_ratio)) / self.density_kg_m3)


RAYLEIGH_COLUMNS = ("rayleigh_alpha_per_s", "rayleigh_beta_s")
MATERIAL_COLUMNS = tuple(
    field.name
    for field in fields(Material)
    if field.default is MISSING and field.name not in RAYLEIGH_COLUMNS
)
# Open and closed ends of what is physically possible.
PHYSICAL_RANGES = {
    "density_kg_m3": ("positive", lambda x: x > 0),
    "youngs_modulus_pa": ("positive", lambda x: x > 0),
    "poisson_ratio": ("between -1 and 0.5, both excluded", lambda x: -1 < x < 0.5),
    "roughness": ("between 0 and 1", lambda x: 0 <= x <= 1),
    "metallic": ("between 0 and 1", lambda x: 0 <= x <= 1),
}
# Columns that a table may lack, or leave empty.
CONTACT_RANGES = {
    "friction": ("zero or positive", lambda x: x >= 0),
    "restitution": ("between 0 and 1", lambda x: 0 <= x <= 1),
    "roughness_um": ("zero or positive", lambda x: x >= 0),
}
# A row has Rayleigh's two, a loss factor, or both.
DAMPING_RANGES = {
    "rayleigh_alpha_per_s": ("zero or positive", lambda x: x >= 0),
    "rayleigh_beta_s": ("zero or positive", lambda x: x >= 0),
    "loss_factor": ("zero or positive, and below 2, where nothing rings", lambda x: 0 <= x < 2),
    "loss_exponent": ("between -1 (Rayleigh's alpha alone) and 1 (beta alone)", lambda x: -1 <= x <= 1),
}


def read_materials(path: Path | str) -> dict[str, Material]:
    """Read a CSV table of materials, by lower-case name.

    Raises
    ------
    InputError
        Naming the file, row and column of a value that is missing, not a number or impossible; of a name
        that comes twice; of a column that is missing; of a row without damping, or with half of it.

    Examples
    --------
    >>> glass = read_materials("materials.csv")["glass"]
    >>> glass.density_kg_m3, glass.youngs_modulus_pa
    (2600.0, 62000000000.0)
    """
    path = Path(path)
    try:
        require_regular(path)
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), f"cannot be read ({error})", "Give a CSV table of materials.") from error
    if not rows:
        raise InputError(
            str(path), "no materials", f"Give one a row, with columns {', '.join(MATERIAL_COLUMNS)}."
        )
    missing = [column for column in MATERIAL_COLUMNS if column not in rows[0]]
    if missing:
        raise InputError(
            str(path), f"column {missing[0]} is missing", f"Needed are {', '.join(MATERIAL_COLUMNS)}."
        )
    materials: dict[str, Material] = {}
    for number, row in enumerate(rows, start=2):
        where = f"{path}, row {number}"
        name = (row["name"] or "").strip().lower()
        if not name:
            raise InputError(where, "name is empty", "Name the material.")
        if name in materials:
            raise InputError(where, f"material {name} comes twice", "Keep one of the rows.")
        numbers = {column: _number(where, column, row[column]) for column in PHYSICAL_RANGES}
        stated = [column for column in CONTACT_RANGES if _cell(row, column)]
        numbers |= {column: _number(where, column, row[column]) for column in stated}
        cells: dict[str, Any] = dict.fromkeys(RAYLEIGH_COLUMNS) | numbers | _damping(where, row)
        cells |= {column: _cell(row, column) for column in ("citation", "contact_citation", "loss_citation")}
        materials[name] = Material(name=name, **cells)
    return materials


def find_material(materials: Mapping[str, Material], name: str, where: str) -> Material:
    """Return the material of that name, case ignored.

    Raises
    ------
    InputError
        For an unknown name: says `where` it was met and which names are known.
    """
    key = name.strip().lower()
    if key not in materials:
        near = difflib.get_close_matches(key, materials, n=1)
        hint = f"Did you mean {near[0]}? " if near else ""
        raise InputError(
            where, f"unknown material {name!r}", f"{hint}Known are {', '.join(sorted(materials))}."
        )
    return materials[key]


def _cell(row: Mapping[str, str | None], column: str) -> str:
    return (row.get(column) or "").strip()


def _damping(where: str, row: Mapping[str, str | None]) -> dict[str, float]:
    """Return the stated columns of damping: a loss factor, Rayleigh's two, or both."""
    stated = {column: _number(where, column, row[column]) for column in DAMPING_RANGES if _cell(row, column)}
    halves = [column for column in RAYLEIGH_COLUMNS if column not in stated]
    if "loss_factor" not in stated and ("loss_exponent" in stated or len(halves) == 2):
        remedy = f"State it, or {' and '.join(RAYLEIGH_COLUMNS)}."
        raise InputError(where, "loss_factor is missing", remedy)
    if len(halves) == 1:
        raise InputError(where, f"{halves[0]} is missing", f"State {' and '.join(RAYLEIGH_COLUMNS)}.")
    return stated


def _number(where: str, column: str, text: str | None) -> float:
    meaning, holds = {**PHYSICAL_RANGES, **CONTACT_RANGES, **DAMPING_RANGES}[column]
    try:
        value = float(text or "")
    except ValueError:
        raise InputError(where, f"{column} is {text!r}, not a number", f"It must be {meaning}.") from None
    if not (math.isfinite(value) and holds(value)):
        raise InputError(where, f"{column} is {value:g}", f"It must be {meaning}.")
    return value
