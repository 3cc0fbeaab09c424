"""The command `modes`: the modal sound of a mesh, without making an Object File."""

import argparse
import json
import math
import time
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
    command.add_argument(
        "--accuracy-cents", type=float, default=5.0, help="wanted error of the first 50 (default 5)"
    )
    command.add_argument(
        "--wall", type=float, help="least thickness of walls in metres, where a scan fused them"
    )
    command.add_argument("--shell", type=float, help="wall of a vessel that was scanned solid, metres")
    command.add_argument("--seed", type=int, default=0, help="seed (default 0)")
    command.add_argument("--json", action="store_true", help="print JSON")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Solve and print."""
    from objectfolder.audio.materials import find_material, read_materials
    from objectfolder.audio.modes import simulate_modes
    from objectfolder.geometry.ingest import ingest_object, textured_mesh_of

    material = find_material(read_materials(Path(options.materials)), options.material, options.materials)
    started = time.process_time()
    surface = textured_mesh_of(
        ingest_object(Path(options.mesh), None, options.length, Path(options.mesh).stem, with_textures=False)
    ).surface
    seconds = {"ingest": time.process_time() - started}
    modes = simulate_modes(
        surface,
        material,
        max_frequency_hz=options.max_frequency,
        max_modes=options.max_modes,
        accuracy_cents=options.accuracy_cents,
        wall_m=options.wall,
        shell_m=options.shell,
        training_points=8,
        held_out_points=8,
        seed=options.seed,
        name=Path(options.mesh).name,
        seconds=seconds,
    )
    attributes = modes.attributes
    dampings = modes["dampings_per_s"].tolist()
    result = {
        "frequencies_hz": modes["frequencies_hz"].tolist(),
        "dampings_per_s": dampings,
        "t60_s": [math.log(1000) / damping if damping > 0 else None for damping in dampings],
        "error_estimates_cents": [
            None if math.isnan(error) else error for error in modes["error_estimates_cents"].tolist()
        ],
        "count_certificate": attributes["count_certificate"],
        "error_estimate_cents": attributes["error_estimate_cents"],
        "geometry_error_estimate_cents": attributes["geometry_error_estimate_cents"],
        "frequency_limit_hz": attributes["stated_frequency_limit_hz"],
        "bodies": attributes["discretisation"].get("bodies"),
        "discretisation": attributes["discretisation"],
        "seconds": seconds,
    }
    if options.json:
        print(json.dumps(result))
        return
    _print_table(result, options.material)


def _print_table(result: dict[str, Any], material: str) -> None:
    count = len(result["frequencies_hz"])
    print(f"{count} modes below {result['frequency_limit_hz']:.0f} Hz in {material}")
    columns = ("frequencies_hz", "dampings_per_s", "t60_s", "error_estimates_cents")
    for index, row in enumerate(zip(*(result[name] for name in columns), strict=True)):
        frequency, damping, t60, error = row
        rings = f"T60 {t60:8.3f} s" if t60 is not None else "undamped      "
        known = f"error {error:6.1f} cents" if error is not None else ""
        print(f"{index:4d} {frequency:10.2f} Hz  damping {damping:10.3f} 1/s  {rings}  {known}".rstrip())
    certificate = result["count_certificate"]
    print(
        f"count: {certificate['counted']} eigenvalues below the limit = {certificate['rigid']} rigid + "
        f"{certificate['elastic_found']} found ({certificate['method']})"
    )
    geometry = result["geometry_error_estimate_cents"]
    if geometry is not None:
        print(f"shape: the mean wall of the solid is off by what bends frequencies {geometry:.1f} cents")
    print("CPU seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in result["seconds"].items()))
