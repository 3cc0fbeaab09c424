"""A gallery: a folder of pages of Object Files that any web server hosts.

``index.html`` has a tile an object, which turns and sounds. ``objects/`` has a page of each with the player
of reports, and ``data/object_files/`` the files themselves. Pages ask no other server for anything.
"""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.export.files import MANIFEST, new_folder, write_json
from objectfolder.fidelity.sheets import webp
from objectfolder.making.materials import Material
from objectfolder.object_file import ObjectFile
from pipeline.dataset.counts import counted
from pipeline.dataset.records import SAFE_ID
from pipeline.dataset.stages import OBJECT_FILES
from pipeline.publish.gallery.data_sheet import data_sheet
from pipeline.publish.report.object_page import OBJECTS, PAGE, PLAYER
from pipeline.publish.report.sounds import wav_of
from pipeline.publish.report.templates import megabytes, security_policy, template_environment
from pipeline.publish.viewer.static import player_script, write_player_assets

TEMPLATES = Path(__file__).parent / "template"
FRAMES, PIXELS, SUB_RAYS = 24, 240, 4  # of a tile that turns; the style sheet names the frames, too
STRIKE_S, STRIKE_N_S, SAMPLE_RATE_HZ = 1.6, 0.05, 44100


@dataclass(frozen=True)
class GallerySummary:
    """A gallery that was written."""

    folder: str
    objects: tuple[str, ...]
    bytes: int

    def __str__(self) -> str:
        return f"{self.folder}: {counted(len(self.objects), 'object')}, {megabytes(self.bytes)}"


def write_gallery(
    files: Sequence[Path],
    output: Path,
    materials: dict[str, Material],
    *,
    title: str,
    overwrite: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> GallerySummary:
    """Write a gallery of Object Files.

    Parameters
    ----------
    files
        Object Files; no two of one id.
    output
        A folder that does not exist yet, or an earlier gallery.
    materials
        Table of materials, by name: an Object File has no friction of its own.
    title
        Heading of the first page.
    overwrite
        Replace an earlier gallery.
    progress
        Called with the id of each object before its page is made.

    Raises
    ------
    InputError
        An id that is no file name, or that comes twice, or a folder that is no gallery.
    FormatError
        A file that is no Object File, or a damaged one.
    """
    environment = template_environment(TEMPLATES)
    tiles: dict[str, dict[str, Any]] = {}
    with new_folder(output, overwrite=overwrite) as folder:
        pages, copies = folder / OBJECTS, folder / OBJECT_FILES.path(Path(), "x").parent
        pages.mkdir()
        copies.mkdir(parents=True)
        write_player_assets(pages)
        for path in files:
            file = ObjectFile.load(path)
            object_id = str(file.description["object"]["id"])
            if not SAFE_ID.fullmatch(object_id):
                raise InputError(str(path), f"the id {object_id!r} is no file name", "Give it another.")
            if object_id in tiles:
                raise InputError(str(path), f"{object_id} is there twice", "Leave one of the files out.")
            progress(object_id)
            shutil.copyfile(path, copies / f"{object_id}{OBJECT_FILES.suffix}")
            (pages / f"{object_id}{PLAYER}").write_bytes(player_script(path, object_id))
            tiles[object_id] = _tile(file, object_id, pages)
            page = environment.get_template("object.html.j2").render(
                policy=security_policy(environment, ()),
                tile=tiles[object_id],
                sheet=data_sheet(file, materials),
                bytes=path.stat().st_size,
            )
            (pages / f"{object_id}{PAGE}").write_text(page, encoding="utf-8")
        index = environment.get_template("index.html.j2").render(
            policy=security_policy(environment, ("gallery.js",)),
            title=title,
            tiles=list(tiles.values()),
            frames=FRAMES,
            pixels=PIXELS,
        )
        (folder / "index.html").write_text(index, encoding="utf-8")
        write_json(folder / MANIFEST, {"format": "gallery", "objects": sorted(tiles)})
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return GallerySummary(str(output), tuple(tiles), size)


def _tile(file: ObjectFile, object_id: str, folder: Path) -> dict[str, Any]:
    """Write the pictures and the sound of a tile; return what pages show of it."""
    turning = file.pictures(FRAMES, PIXELS, sub_rays=SUB_RAYS)
    (folder / f"{object_id}.webp").write_bytes(webp(np.concatenate(list(turning), axis=1)).tobytes())
    rings = len(file.modes.eigenvalues) > 0
    if rings:
        point, normal = file.sample_contacts(1, seed=0, reachable=False)
        sound = file.strike(point, -STRIKE_N_S * normal, duration_s=STRIKE_S, sample_rate_hz=SAMPLE_RATE_HZ)[
            0
        ]
        (folder / f"{object_id}.wav").write_bytes(wav_of(sound, SAMPLE_RATE_HZ))
    return {"id": object_id, "name": file.name, "material": file.material or "", "rings": rings}
