"""One object put into a table: everything checked before anything is written."""

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from objectfolder.errors import InputError
from objectfolder.making.materials import Material, find_material, read_materials
from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.making.mesh.walls import WallFinding, WallMeasures
from objectfolder.making.solid.thickening import hollow, thicken
from objectfolder.products.store import Product
from objectfolder.surface.textured_mesh import (
    LONGEST_M,
    SHORTEST_M,
    UNUSUAL_M,
    TexturedMesh,
    textured_mesh_of,
)
from objectfolder.vision.appearance import OPAQUE
from pipeline.dataset.catalogue import AS_IN_FILE, check_id
from pipeline.intake.add.add_request import AddRequest
from pipeline.intake.add.source_copy import (
    Layout,
    copy_files,
    digest_of,
    folder_digest,
    layout_of,
    object_id_of,
    words_of,
)
from pipeline.intake.add.table_rows import locked, read_table, with_row, write_table
from pipeline.intake.check.spdx import likely_spdx, spdx
from pipeline.run.decimated_mesh import with_decimated_mesh
from pipeline.run.doubtful_size import clean_mesh, size_doubts
from pipeline.run.looks import looks_of

UNITS_M = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254}
PLAUSIBLE_M = (0.01, 2.5)
"""Longest sides of things that are held, struck and looked at."""


def possible_lengths(side: float) -> dict[str, float]:
    """Return the longest side in metres for each unit that would make it plausible."""
    least, most = PLAUSIBLE_M
    return {name: side * unit for name, unit in UNITS_M.items() if least <= side * unit <= most}


def check_unit(where: str, side: float) -> None:
    """Raise `InputError` for a longest side that is implausible in metres; the remedy names each unit."""
    if SHORTEST_M <= side <= UNUSUAL_M:
        return
    lengths = possible_lengths(side) if side >= SHORTEST_M else {}
    remedy = "; ".join(f"if it is in {name}: --length {length:.6g}" for name, length in lengths.items())
    remedy = remedy[:1].upper() + remedy[1:] or "State the longest side in metres with --length"
    if side <= LONGEST_M:
        remedy += f"; if it really is {side:.6g} m long: --length {side:.6g}"
    finding = f"its longest side is {side:.6g}, which is hardly in metres, and no unit is stated"
    raise InputError(where, finding, remedy)


WITHOUT_NAMING = frozenset(("CC0-1.0", "0BSD", "Unlicense", "PDDL-1.0", "MIT-0"))
"""Licences that do not ask for the author to be named."""


@dataclass(frozen=True)
class Checked:
    """An object that can be added.

    Parameters
    ----------
    row
        Cells by column but for the paths of mesh and texture.
    layout
        Its files and where they go.
    product
        The cleaned, measured mesh.
    walls, findings
        What was measured of its walls, and what is doubtful about them with this material.
    warnings
        Other doubts.
    """

    object_id: str
    row: Mapping[str, str]
    layout: Layout
    product: Product
    material: Material
    walls: WallMeasures
    findings: tuple[WallFinding, ...]
    warnings: tuple[str, ...]

    def figures(self) -> dict[str, Any]:
        """Return what was measured, for JSON: metres, kilograms, cubic metres."""
        return {
            "id": self.object_id,
            "name": self.row["name"],
            "licence": self.row["licence"],
            "material": self.material.name,
            "extents_m": list(self.product.attributes["length"]["extents_m"]),
            "looks": looks_of(textured_mesh_of(self.product)),
            "triangles": len(self.product["faces"]),
            "volume_m3": self.walls.volume_m3,
            "mass_kg": self.walls.volume_m3 * self.material.density_kg_m3,
            "walls": asdict(self.walls),
            "warnings": [*self.warnings, *map(str, self.findings)],
        }


@dataclass(frozen=True)
class Added:
    """Where an object is now; `changed` is false where it was there already, the same."""

    folder: Path
    changed: bool


@contextmanager
def checked_object(request: AddRequest) -> Iterator[Checked]:
    """Yield what `check_object` returns; the files of a decimated mesh are removed afterwards."""
    if request.decimate is None:
        yield check_object(request)
        return
    request.check()
    material = find_material(read_materials(request.materials), request.material, "--material")
    request = replace(request, object_id=request.object_id or object_id_of(request.mesh))
    with TemporaryDirectory(prefix="objectfolder-decimated-") as folder:
        coarse, warnings = with_decimated_mesh(request, material, Path(folder))
        checked = check_object(coarse)
        yield replace(checked, warnings=(*warnings, *checked.warnings))


def check_object(request: AddRequest) -> Checked:
    """Check all that can be checked without writing.

    Raises
    ------
    InputError
        Anything that keeps the object from being made, with the option to give or the cell to correct.
    """
    material = find_material(read_materials(request.materials), request.material, "--material")
    licence = _licence(request.licence)
    object_id = request.object_id or object_id_of(request.mesh)
    check_id(object_id, "--id")
    request.check()
    where = f"{object_id} ({request.mesh})"
    if request.length_m is None:
        check_unit(where, float(clean_mesh(request).extents.max()))
    product = ingest_object(
        request.mesh,
        texture_path=request.texture,
        length_m=request.length_m,
        object_id=object_id,
        up=request.up,
    )
    if not request.attribution and licence not in WITHOUT_NAMING:
        finding = f"{licence} asks for the author to be named"
        raise InputError("--attribution", finding, "Name whom to thank")
    mesh = textured_mesh_of(product)
    if request.shell_m is not None:
        hollow(mesh.surface, request.shell_m, where)
    if request.wall_m is not None:
        thicken(mesh.surface, request.wall_m, where)
    walls = WallMeasures(**product.attributes["walls"])
    warnings, findings = request.findings(product.attributes, material)
    if doubts := size_doubts(mesh, request, material):
        warnings.append(f"{'; '.join(doubts)}: is that meant?{_units(mesh, request)}")
    row = _row(request, object_id, material.name, licence)
    layout = layout_of(request.mesh, request.texture)
    return Checked(object_id, row, layout, product, material, walls, findings, tuple(warnings))


def _units(mesh: TexturedMesh, request: AddRequest) -> str:
    """Return which --length to give if the file is not in metres; empty if a length is stated."""
    if request.length_m is not None:
        return ""
    lengths = possible_lengths(float(mesh.extents.max())).items()
    return "".join(f" If it is in {name}: --length {length:.6g}." for name, length in lengths)


def _row(request: AddRequest, object_id: str, material: str, licence: str) -> dict[str, str]:
    """Return the cells by column; raise InputError for text that is not printable."""
    row = {
        "id": object_id,
        "name": request.name or words_of(object_id),
        "material": material,
        "length_m": AS_IN_FILE if request.length_m is None else repr(request.length_m),
        "source": request.source,
        "licence": licence,
        "attribution": request.attribution or "",
        "up": request.up or "",
        "senses": " ".join(request.senses) if request.silent else "",
        "glass": "" if request.glass == OPAQUE else request.glass,
    }
    for column in ("roughness", "metallic", "wall_m", "shell_m", "mass_kg"):
        value = getattr(request, column)
        row[column] = "" if value is None else repr(value)
    for column, text in row.items():
        if any("\udc80" <= letter <= "\udcff" for letter in text):
            finding = f"{text!r} was typed in another encoding than Python takes from the locale"
            raise InputError(f"--{column}", finding, "Set PYTHONUTF8=1, or LC_ALL=C.UTF-8")
        if not text.isprintable():
            raise InputError(f"--{column}", f"{text!r} holds characters that do not print", "Leave them out")
    return row


def put_object(checked: Checked, table_path: Path, *, replace: bool) -> Added:
    """Copy the files beside the table, then add the row, in place of one of the same id if `replace`.

    There is never a row without its files.

    Raises
    ------
    InputError
        The id is in the table with other content, or the table cannot be edited.
    """
    name = table_path.stem if table_path.suffix else f"{table_path.name}_files"
    parent, digest = table_path.parent / name, digest_of(checked.layout.files)
    folders = [parent / checked.object_id, parent / f"{checked.object_id}-{digest[:12]}"]
    with locked(table_path):
        table = read_table(table_path)
        index, old = table.row_of(checked.object_id) or (None, {})
        same = next(
            (candidate for candidate in folders if candidate.is_dir() and folder_digest(candidate) == digest),
            None,
        )
        folder = same or next((candidate for candidate in folders if not candidate.exists()), None)
        if folder is None:
            raise InputError(str(folders[-1]), "is in the way", "Remove it")
        places = {"mesh": checked.layout.mesh, "texture": checked.layout.texture}
        row = dict(checked.row) | {
            column: (folder / place).relative_to(table_path.parent).as_posix() if place else ""
            for column, place in places.items()
        }
        if index is not None and same and all(old.get(column, "") == row[column] for column in row):
            return Added(folder, False)
        if index is not None and not replace:
            raise InputError(
                f"{table_path}, {old['id']}",
                "is in the table already, with other content",
                "Give another --id, or --replace to put this in its place",
            )
        if same is None:
            copy_files(checked.layout, folder)
        write_table(table_path, with_row(table, row, index))
        _remove_unused(table_path, parent, old.get("mesh", ""))
    return Added(folder, True)


def _licence(text: str) -> str:
    if identifier := spdx(text):
        return identifier
    near = likely_spdx(text)
    hint = f"Did you mean {near}? " if near else ""
    raise InputError(
        "--licence",
        f"{text!r} is not a licence identifier of SPDX",
        f"{hint}Use an identifier of https://spdx.org/licenses, such as CC-BY-4.0, or LicenseRef-NAME",
    )


def _remove_unused(table_path: Path, folder_of_objects: Path, mesh_cell: str) -> None:
    """Remove the folder that a replaced row lay in, if it is one made here and no row needs it."""
    place = Path(os.path.normpath(table_path.parent / mesh_cell))
    if folder_of_objects not in place.parents[1:]:
        return
    folder = folder_of_objects / place.relative_to(folder_of_objects).parts[0]
    rows = [row for _, row in read_table(table_path).rows()]
    cells = [table_path.parent / row.get(column, "") for row in rows for column in ("mesh", "texture")]
    if not any(cell.is_relative_to(folder) for cell in cells):
        shutil.rmtree(folder, ignore_errors=True)
