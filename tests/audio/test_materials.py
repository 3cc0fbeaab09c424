"""The table of materials and its errors."""

import csv
import io
from pathlib import Path

import pytest

from objectfolder.errors import InputError
from objectfolder.making.damping import RAYLEIGH, LossFactor, Rayleigh, damping_of
from objectfolder.making.materials import Material, find_material, read_materials

TABLE = Path(__file__).parents[2] / "data" / "materials.csv"


def test_the_seven_materials_of_the_papers() -> None:
    materials = read_materials(TABLE)
    assert sorted(materials) == ["ceramic", "glass", "iron", "plastic", "polycarbonate", "steel", "wood"]
    steel = materials["steel"]
    assert (steel.density_kg_m3, steel.youngs_modulus_pa, steel.poisson_ratio) == (7850, 2e11, 0.29)
    assert (steel.rayleigh_alpha_per_s, steel.rayleigh_beta_s) == (5, 3e-8)
    assert steel.shear_speed_m_s == pytest.approx(3142.464, rel=1e-6)
    assert all(material.citation and material.loss_citation for material in materials.values())
    assert (steel.loss_factor, steel.loss_exponent) == (3e-4, 0)


def test_an_unknown_material_names_the_place_and_the_known_ones() -> None:
    materials = read_materials(TABLE)
    assert find_material(materials, " Ceramic ", "here").name == "ceramic"
    with pytest.raises(InputError, match=r"objects.csv, row 3: unknown material 'stel'.*Did you mean steel"):
        find_material(materials, "stel", "objects.csv, row 3")


def test_an_impossible_value_names_file_row_and_column(subtests: pytest.Subtests, tmp_path: Path) -> None:
    for column, value in [
        ("poisson_ratio", "0.5"),
        ("poisson_ratio", "-1"),
        ("density_kg_m3", "0"),
        ("youngs_modulus_pa", "nan"),
        ("youngs_modulus_pa", "inf"),
        ("rayleigh_beta_s", "-1e-7"),
        ("rayleigh_beta_s", ""),
        ("loss_factor", "2"),
        ("loss_factor", ""),
        ("loss_exponent", "1.1"),
        ("roughness", "1.5"),
        ("metallic", "shiny"),
        ("roughness_um", "-1"),
    ]:
        with subtests.test(column=column):
            header, *rows = TABLE.read_text().splitlines()
            cells = next(csv.reader([rows[1]]))
            cells[header.split(",").index(column)] = value
            path = tmp_path / "materials.csv"
            row = io.StringIO()
            csv.writer(row).writerow(cells)
            path.write_text("\n".join([header, rows[0], row.getvalue()]))
            with pytest.raises(InputError, match=rf"materials\.csv, row 3: {column}"):
                read_materials(path)


def test_missing_columns_doubles_and_files_are_named(tmp_path: Path) -> None:
    text = TABLE.read_text()
    path = tmp_path / "materials.csv"
    path.write_text(text.replace("poisson_ratio", "nu"))
    with pytest.raises(InputError, match="poisson_ratio is missing"):
        read_materials(path)
    path.write_text(text + text.splitlines()[1] + "\n")
    with pytest.raises(InputError, match="ceramic comes twice"):
        read_materials(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_materials(tmp_path / "none.csv")


def test_a_table_of_either_law_is_read_and_one_of_neither_is_not(tmp_path: Path) -> None:
    """Without a loss factor a row of Rayleigh's two is damped by them; a loss factor alone is enough."""
    row = {
        "name": "gold",
        "density_kg_m3": 19300,
        "youngs_modulus_pa": 7.9e10,
        "poisson_ratio": 0.44,
        "roughness": 0.2,
        "metallic": 1,
        "citation": "",
    }
    path = tmp_path / "materials.csv"

    def read(**damping: float) -> Material:
        with path.open("w", newline="") as file:
            writer = csv.DictWriter(file, [*row, *damping])
            writer.writeheader()
            writer.writerow(row | damping)
        return read_materials(path)["gold"]

    old = read(rayleigh_alpha_per_s=5, rayleigh_beta_s=1e-7)
    assert damping_of(old) == damping_of(old, RAYLEIGH) == Rayleigh(5, 1e-7)
    own = read(loss_factor=3e-4)
    assert damping_of(own) == LossFactor(3e-4)
    with pytest.raises(InputError, match="material gold: it states no rayleigh_alpha_per_s"):
        damping_of(own, RAYLEIGH)
    with pytest.raises(InputError, match=r"materials\.csv, row 2: loss_factor is missing"):
        read()
    with pytest.raises(ValueError, match="damping 'viscous': use one of loss_factor, rayleigh"):
        damping_of(own, "viscous")
