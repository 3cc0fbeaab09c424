"""The command `modes`: the modal sound of a mesh, without making an Object File."""

import argparse
import json
import math
import os
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).parents[2]
MATERIALS = REPOSITORY / "data" / "materials.csv"


def add_commands(commands: Any) -> None:
    """Add the commands of this module to a parser's sub-commands."""
    text = "solve the modes of a mesh: frequencies, dampings, certificate, error estimate"
    command = commands.add_parser("modes", help=text, description=text)
    command.add_argument("mesh", help="OBJ, glTF, GLB, PLY or STL")
    command.add_argument("--material", required=True, help="a row of the materials table")
    command.add_argument("--materials", default=str(MATERIALS), help="materials table (CSV)")
    command.add_argument("--length", type=float, help="longest side in metres (default: as in the file)")
    command.add_argument("--max-frequency", type=float, default=20000.0, help="hertz (default 20000)")
    command.add_argument("--max-modes", type=int, default=256, help="at most so many modes (default 256)")
    command.add_argument("--seed", type=int, default=0, help="seed (default 0)")
    command.add_argument("--json", action="store_true", help="print JSON")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Solve and print."""
    from objectfolder.audio.materials import find_material, read_materials
    from objectfolder.audio.modes import simulate_modes
    from objectfolder.geometry.ingest import ingest_object, textured_mesh_of

    material = find_material(read_materials(Path(options.materials)), options.material, options.materials)
    started = _cpu_seconds()
    surface = textured_mesh_of(
        ingest_object(Path(options.mesh), None, options.length, Path(options.mesh).stem, with_textures=False)
    ).surface
    ingested = _cpu_seconds()
    modes = simulate_modes(
        surface,
        material,
        max_frequency_hz=options.max_frequency,
        max_modes=options.max_modes,
        training_points=8,
        held_out_points=8,
        seed=options.seed,
        name=Path(options.mesh).name,
    )
    solved = _cpu_seconds()
    frequencies, dampings = modes["frequencies_hz"].tolist(), modes["dampings_per_s"].tolist()
    result = {
        "frequencies_hz": frequencies,
        "dampings_per_s": dampings,
        "count_certificate": modes.attributes["count_certificate"],
        "error_estimate_cents": modes.attributes["error_estimate_cents"],
        "frequency_limit_hz": modes.attributes["stated_frequency_limit_hz"],
        "discretisation": modes.attributes["discretisation"],
        "seconds": {"ingest": ingested - started, "mesh_and_solve": solved - ingested},
    }
    if options.json:
        print(json.dumps(result))
        return
    print(f"{len(frequencies)} modes below {result['frequency_limit_hz']:.0f} Hz in {options.material}")
    for index, (frequency, damping) in enumerate(zip(frequencies, dampings, strict=True)):
        t60 = f"{math.log(1000) / damping:8.3f} s" if damping > 0 else "undamped"
        print(f"{index:4d} {frequency:10.2f} Hz  damping {damping:10.3f} 1/s  T60 {t60}")
    print(f"certificate {result['count_certificate']}")
    print(f"estimated error {result['error_estimate_cents']} cents")


def _cpu_seconds() -> float:
    """CPU seconds of this process and of the ones it has ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
