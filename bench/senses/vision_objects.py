"""Sight of ten scans of seven materials, of ten hard ones, or of all, on held-out cameras and lights.

    python -m bench vision_objects --folder FOLDER [--hard | --all] [--learned] [--objects CSV] [--only ID]

It is computed from the known material, or learned from 100 views. Hard are thin wires, sharp spikes, many
parts, and iron that lights itself; all are those of the table whose material a file can hold. Views, networks
and rows are kept in FOLDER and not made again; the result is of the rows at hand, and names those that are
missing.
"""

from pathlib import Path
from typing import Any

import numpy as np

from bench.record import conclude, cpu_seconds, measure_once, rows_of, spread
from bench.senses.catalogue import MATERIALS, Scans, scan_arguments, scan_set
from bench.senses.subject import Subject, ViewCounts, errors
from objectfolder.fidelity.sight import trivial_answer
from objectfolder.making.materials import Material, find_material, read_materials
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG
from objectfolder.vision.compositing import on_white

# Nine links of iron, each through the next: the catalogue has no chain.
CHAIN = "chain"
# Shown as iron: their C lights itself.
CAST_IRON = ("052_extra_large_clamp",)
OBJECTS, HARD = scan_set("seen"), scan_set("hard")
# More faces than a lattice of base colours has places for: sight of it is learned.
LARGE = ("wooden_table_02",)
# Views of learned sight; what is computed asks no training views, and `simulate_views` makes one at least.
COUNTS = {"learned": ViewCounts(128, 100, 32, 8, 256), "known": ViewCounts(128, 1, 32, 8, 256)}
COMPARED = (
    "8-bit sRGB on white of VisionNet against Cycles (PSNR and SSIM, means of held-out views; foreground: "
    "pixels covered by half), beside the noise of that truth and the mean colour in the true silhouette"
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
    corner, right = along * around + turn, (along + 1) % across * around + turn
    up, both = along * around + (turn + 1) % around, (along + 1) % across * around + (turn + 1) % around
    corners = np.stack([corner, right, both, corner, both, up], axis=-1).reshape(-1, 3)
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


def row(subject: Subject) -> dict[str, Any]:
    """Return the errors of an object, what its sight cost, and what its truth is worth."""
    net, costs = subject.sight
    cameras, lamps = subject.held_out("camera_to_world"), subject.held_out("light_position")
    rgba = subject.held_out("rgba")
    net.render(cameras[:1], lamps[:1], 8, 20.0)  # the first query compiles
    start = cpu_seconds()
    image = net.render(cameras, lamps, rgba.shape[1:3], FIELD_OF_VIEW_DEG)
    seconds = (cpu_seconds() - start) / len(image)
    noise = {key: subject.views.attributes[key] for key in ("noise_floor_db", "noise_floor_foreground_db")}
    return {
        **errors(rgba, on_white(image)),
        **costs,
        **noise,
        "image_cpu_s": seconds,
        "views_cpu_s": subject.views_cpu_s,
        "mean_colour": errors(rgba, trivial_answer(subject.views)),
    }


def main() -> None:
    """Measure the objects asked for."""
    parser = scan_arguments(__doc__, "views, networks and rows", only=())
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--hard", action="store_true", help="hard scans")
    which.add_argument("--all", action="store_true", help="all scans of the table")
    parser.add_argument("--learned", action="store_true", help="by a network of 100 views")
    options = parser.parse_args()
    material, scans = "learned" if options.learned else "known", HardScans(options.objects)
    rows, record, objects = options.folder / "rows" / material, "vision_objects", OBJECTS
    if options.hard:
        record, objects = "hard_scans", HARD
    elif options.all:
        record, objects = "all_scans", tuple(name for name in scans.ids if name not in LARGE)

    def measure(name: str) -> dict[str, Any]:
        return row(Subject(scans, name, options.folder, COUNTS[material], material))

    rows_of(options.only or objects, measure, rows)
    table = {name: measure_once(path, dict) for name in objects if (path := rows / f"{name}.json").exists()}
    fidelity = ("psnr_foreground_db", "psnr_foreground_worst_db", "psnr_lit_db", "psnr_db", "ssim")
    summary: dict[str, Any] = {key: spread(table.values(), key) for key in fidelity}
    summary |= {key: spread(table.values(), key, max) for key in ("fit_cpu_s", "bytes", "image_cpu_s")}
    foreground = [row["psnr_foreground_db"] for row in table.values()]
    summary["worst_tenth_psnr_foreground_db"] = float(np.percentile(foreground, 10))
    summary["count"], summary["missing"] = len(table), [name for name in objects if name not in table]
    settings = {
        "views": vars(COUNTS[material]),
        "materials": {name: scans.material(name).name for name in table},
    }
    record += "" if options.learned else "_known"
    conclude(record, {"summary": summary, "objects": table}, settings, COMPARED)
