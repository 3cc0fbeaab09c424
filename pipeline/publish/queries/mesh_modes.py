"""The modal sound of a mesh, without making an Object File."""

import math
import time
from pathlib import Path
from typing import Any

import pandas

from objectfolder.audio.materials import find_material, read_materials
from objectfolder.audio.modes.modes import simulate_modes
from objectfolder.mesh.ingest import ingest_object
from objectfolder.mesh.mesh import textured_mesh_of
from pipeline.publish.queries.requests import ModesOfMesh

POINTS = 8  # with mode shapes; the command shows none


def solve_modes(mesh: Path, wanted: ModesOfMesh) -> dict[str, Any]:
    """Return frequencies, dampings, error estimates and the certificate of their count, as JSON has them.

    Raises
    ------
    InputError
        A mesh or a material that cannot be used.
    SimulationError
        The solver did not reach its accuracy.
    """
    material = find_material(read_materials(wanted.materials), wanted.material, str(wanted.materials))
    started = time.process_time()
    surface = textured_mesh_of(
        ingest_object(mesh, None, wanted.length_m, mesh.stem, with_textures=False)
    ).surface
    seconds = {"ingest": time.process_time() - started}
    modes = simulate_modes(
        surface,
        material,
        max_frequency_hz=wanted.max_frequency_hz,
        max_modes=wanted.max_modes,
        accuracy_cents=wanted.accuracy_cents,
        wall_m=wanted.wall_m,
        shell_m=wanted.shell_m,
        training_points=POINTS,
        held_out_points=POINTS,
        seed=wanted.seed,
        name=mesh.name,
        seconds=seconds,
    )
    dampings = modes["dampings_per_s"].tolist()
    errors = modes["error_estimates_cents"].tolist()
    said = ("count_certificate", "error_estimate_cents", "geometry_error_estimate_cents", "discretisation")
    return {
        "frequencies_hz": modes["frequencies_hz"].tolist(),
        "dampings_per_s": dampings,
        "t60_s": [math.log(1000) / damping if damping > 0 else None for damping in dampings],
        "error_estimates_cents": [None if math.isnan(error) else error for error in errors],
        "frequency_limit_hz": modes.attributes["stated_frequency_limit_hz"],
        **{name: modes.attributes[name] for name in said},
        "seconds": seconds,
    }


def modes_table(result: dict[str, Any], material: str) -> str:
    """Return the result of `solve_modes` for people."""
    count, limit_hz = len(result["frequencies_hz"]), result["frequency_limit_hz"]
    lines = [f"{count} modes below {limit_hz:.0f} Hz in {material}"]
    if count:
        columns = ("frequencies_hz", "dampings_per_s", "t60_s", "error_estimates_cents")
        table = pandas.DataFrame({name: result[name] for name in columns}, dtype=float)
        lines.append(table.to_string(float_format="{:.2f}".format, na_rep="unknown"))
    certificate = result["count_certificate"]
    lines.append(
        f"count: {certificate['counted']} eigenvalues below the limit = {certificate['rigid']} rigid + "
        f"{certificate['elastic_found']} found ({certificate['method']})"
    )
    geometry = result["geometry_error_estimate_cents"]
    if geometry is not None:
        lines.append(
            f"shape: the error of the solid's mean wall changes frequencies by about {geometry:.1f} cents"
        )
    seconds = ", ".join(f"{name} {value:.1f}" for name, value in result["seconds"].items())
    return "\n".join([*lines, f"CPU seconds: {seconds}"])
