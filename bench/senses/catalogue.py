"""The scans that comparisons of the senses are about: their meshes, materials and modes."""

import argparse
import csv
import os
from collections.abc import Sequence
from pathlib import Path

from bench.record import REPOSITORY, arguments
from objectfolder.making.materials import Material, find_material, read_materials
from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.making.modes.modes import simulate_modes
from objectfolder.products.store import Product, read_product, write_product
from objectfolder.surface.surface import Surface
from objectfolder.surface.textured_mesh import TexturedMesh, textured_mesh_of
from pipeline.dataset.catalogue import read_catalogue

FOLDER = Path(os.environ.get("OBJECTFOLDER_SCANS", REPOSITORY.parent / "shared" / "objects"))
MATERIALS = REPOSITORY / "data" / "materials.csv"


def scan_set(name: str) -> tuple[str, ...]:
    """Return the ids of a set of ``scan_sets.csv``.

    ``varied``: several materials and kinds, as bodies, tools, thin walls, figures, sharp boxes. ``sounding``:
    what rings, and what hardly does. ``seen``: metals (mug, spoon, bell, scissors, hammer), gloss (teapot,
    marble), thin (spoon, scissors), self-shadowing (stool, bell, mug). ``hard``: hard to see.
    """
    with Path(__file__).with_name("scan_sets.csv").open(encoding="utf-8", newline="") as lines:
        return tuple(row["id"] for row in csv.DictReader(lines) if row["set"] == name)


class Scans:
    """A catalogue of scans: a row for each (id, material), and beside it a folder `id` with `model.obj`.

    Parameters
    ----------
    table
        CSV, see `read_catalogue`.
    """

    def __init__(self, table: Path) -> None:
        self._materials = read_materials(MATERIALS)
        self._records = {record.id: record for record in read_catalogue(table, self._materials).records}
        self.ids = tuple(self._records)

    def material(self, name: str) -> Material:
        """Return the material of an object."""
        return find_material(self._materials, self._records[name].material, name)

    def folder(self, name: str) -> Path:
        """Return the folder of an object's files."""
        return self._records[name].mesh.parent

    def mesh(self, name: str, with_textures: bool = True) -> TexturedMesh:
        """Return an object cleaned, metres."""
        record = self._records[name]
        product = ingest_object(
            record.mesh,
            length_m=record.length_m,
            object_id=name,
            with_textures=with_textures,
        )
        return textured_mesh_of(product)

    def surface(self, name: str) -> Surface:
        """Return the cleaned surface of an object, metres, without faces that have no area."""
        surface = self.mesh(name, with_textures=False).surface
        return Surface(surface.vertices, surface.faces[surface.face_areas > 0])

    def body(self, name: str) -> tuple[Surface, Material]:
        """Return the cleaned surface and the material of an object."""
        return self.surface(name), self.material(name)

    def modes(self, name: str, surface: Surface, path: Path, **settings: int) -> Product:
        """Return the modes of an object, solved and kept in a file; `settings` as for `simulate_modes`."""
        if not path.exists():
            modes = simulate_modes(surface, self.material(name), name=name, **settings)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_product(path, modes)
        return read_product(path)


def scan_arguments(
    description: str | None, keeps: str, only: Sequence[str] | None = None
) -> argparse.ArgumentParser:
    """Return a parser as of `arguments`, with the option `--objects` for a catalogue of scans."""
    parser = arguments(description, keeps=keeps, only=only)
    parser.add_argument(
        "--objects", type=Path, default=FOLDER / "catalogue.csv", help="catalogue of meshes, CSV"
    )
    return parser
