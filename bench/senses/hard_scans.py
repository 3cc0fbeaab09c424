"""VisionNet on ten hard scans at the defaults: thin wires, sharp spikes, many parts, iron that lights itself.

    python -m bench hard_scans --folder FOLDER [--objects CATALOGUE.csv] [--only ID ...] [--learned]

Their sight is computed from their material, or learned.

Views, networks and rows are kept in FOLDER and not made again; the result is of the rows at hand.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import conclude, kept
from bench.senses.catalogue import MATERIALS, Scans, scan_arguments
from bench.senses.vision_objects import HELD_OUT_SAMPLES, HELD_OUT_VIEWS, RESOLUTION, Subject
from objectfolder.audio.materials import Material, find_material, read_materials
from objectfolder.mesh.mesh import TexturedMesh

CHAIN = "chain"
"""Nine links of iron, each through the next: the catalogue has no chain."""

CAST_IRON = ("052_extra_large_clamp",)
"""Scans shown as iron: their C lights itself."""

OBJECTS = (
    CHAIN,
    *CAST_IRON,
    "Rubbermaid_Large_Drainer",
    "Television_01",
    "painted_wooden_cabinet_02",
    "plastic_monobloc_chair_01",
    "Schleich_Spinosaurus_Action_Figure",
    "Magnifying_Glassassrt",
    "063-a_marbles",
    "Sonny_School_Bus",
)
COMPARED = (
    "8-bit sRGB on white of VisionNet against Cycles (PSNR and SSIM, means of held-out views; foreground: "
    "pixels covered by half), beside the noise of that truth (of the first two held-out views)"
)


class HardScans(Scans):
    """The catalogue, with a chain, and some scans as iron."""

    def __init__(self, table: Path) -> None:
        super().__init__(table)
        self._iron = find_material(read_materials(MATERIALS), "iron", CHAIN)

    def material(self, name: str) -> Material:
        return self._iron if name in (CHAIN, *CAST_IRON) else super().material(name)

    def mesh(self, name: str, with_textures: bool = True) -> TexturedMesh:
        return chain() if name == CHAIN else super().mesh(name, with_textures)


def chain(links: int = 9, across: int = 64, around: int = 24) -> TexturedMesh:
    """Return a chain of oval links of 40 x 28 mm, wire of 7 mm, every other one turned by a right angle."""
    along, turn = np.meshgrid(np.arange(across), np.arange(around), indexing="ij")
    u, v = 2 * np.pi * along / across, 2 * np.pi * turn / around
    x, y, z = (
        (0.0165 + 0.0035 * np.cos(v)) * np.cos(u),
        (0.0105 + 0.0035 * np.cos(v)) * np.sin(u),
        0.0035 * np.sin(v),
    )
    link = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    here, right = along * around + turn, (along + 1) % across * around + turn
    up, both = along * around + (turn + 1) % around, (along + 1) % across * around + (turn + 1) % around
    corners = np.stack([here, right, both, here, both, up], axis=-1).reshape(-1, 3)
    vertices = [
        link[:, [0, 2, 1] if index % 2 else [0, 1, 2]] + [0.024 * index, 0, 0] for index in range(links)
    ]
    faces = [(corners[:, ::-1] if index % 2 else corners) + index * len(link) for index in range(links)]
    grey = np.array([[[170, 168, 165, 255]]], dtype=np.uint8)
    count = links * len(corners)
    return TexturedMesh(
        np.concatenate(vertices),
        np.concatenate(faces),
        np.zeros((count, 3, 2)),
        (grey,),
        np.zeros(count, np.int32),
    )


def main() -> None:
    """Measure the objects asked for."""
    parser = scan_arguments(__doc__, "views, networks and rows")
    parser.add_argument("--only", nargs="+", default=OBJECTS, choices=OBJECTS, metavar="ID")
    parser.add_argument("--learned", action="store_true", help="by a network of 100 views")
    given = parser.parse_args()
    case, record = ("within_120", "hard_scans") if given.learned else ("known", "hard_scans_known")
    scans, rows = HardScans(given.objects), given.folder / "rows" / case
    for name in given.only:
        kept(rows / f"{name}.json", partial(measured, scans, name, given.folder, case))
    found = {name: kept(path, dict) for name in OBJECTS if (path := rows / f"{name}.json").exists()}
    foreground = [row["psnr_foreground_db"] for row in found.values()]
    summary = {
        "foreground_db": {"mean": float(np.mean(foreground)), "worst": min(foreground)},
        "missing": [name for name in OBJECTS if name not in found],
    }
    settings = {
        "resolution_px": RESOLUTION,
        "held_out": f"{HELD_OUT_VIEWS} views at {HELD_OUT_SAMPLES} samples",
        "materials": {name: scans.material(name).name for name in found},
    }
    conclude(record, {"summary": summary, "objects": found}, settings, COMPARED)


def measured(scans: Scans, name: str, folder: Path, case: str) -> dict[str, Any]:
    """Return one object's row."""
    return Subject(scans, name, folder).answer(case)
