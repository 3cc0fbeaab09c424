"""The modal sound of a mesh, without making an Object File; or of an Object File, as it stores it."""

import math
import time
from pathlib import Path
from typing import Any

import numpy as np

import objectfolder
from objectfolder.errors import InputError
from objectfolder.making.damping import LOSS_FACTOR
from objectfolder.making.materials import find_material, read_materials
from objectfolder.object_file import ObjectFile
from pipeline.dataset.counts import columns, counted
from pipeline.publish.queries.requests import ModesOfMesh

POINTS = 8  # with mode shapes; the command shows none


def solve_modes(mesh: Path, request: ModesOfMesh) -> dict[str, Any]:
    """Return frequencies, dampings, error estimates and the certificate of their count, as JSON has them.

    Of an Object File only what it stores: there is no certificate, and one error estimate for all.

    Raises
    ------
    InputError
        A mesh or a material that cannot be used.
    SimulationError
        The solver did not reach its accuracy.
    """
    if mesh.suffix == ".safetensors":
        return _stored_modes(objectfolder.load(mesh))
    materials = read_materials(request.materials)
    if request.material is None:
        raise InputError("--material", "not given", f"Materials are {', '.join(sorted(materials))}.")
    material = find_material(materials, request.material, str(request.materials))
    # An Object File is listed without what meshes need.
    from objectfolder.making.mesh.ingest import ingest_object
    from objectfolder.making.modes.modes import simulate_modes
    from objectfolder.surface.textured_mesh import textured_mesh_of

    start_s = time.process_time()
    ingestion = ingest_object(mesh, length_m=request.length_m, object_id=mesh.stem, with_textures=False)
    seconds = {"ingest": time.process_time() - start_s}
    modes = simulate_modes(
        textured_mesh_of(ingestion).surface,
        material,
        max_frequency_hz=request.max_frequency_hz,
        max_modes=request.max_modes,
        accuracy_cents=request.accuracy_cents,
        wall_m=request.wall_m,
        shell_m=request.shell_m,
        damping=request.damping,
        radiation=request.radiation,
        training_points=POINTS,
        held_out_points=POINTS,
        seed=request.seed,
        name=mesh.name,
        seconds=seconds,
    )
    errors = modes["error_estimates_cents"].tolist()
    text = (
        "count_certificate",
        "error_estimate_cents",
        "geometry_error_estimate_cents",
        "discretisation",
        "accuracy_reached",
    )
    return {
        "material": material.name,
        "damping": modes.attributes["damping"],
        **_ringing(modes["frequencies_hz"], modes["dampings_per_s"], modes["eigenvalues"]),
        "radiation_dampings_per_s": _listed(
            modes["radiation_dampings_per_s"] if "radiation_dampings_per_s" in modes.arrays else None
        ),
        "error_estimates_cents": [None if math.isnan(error) else error for error in errors],
        "frequency_limit_hz": modes.attributes["stated_frequency_limit_hz"],
        **{name: modes.attributes[name] for name in text},
        "warnings": ingestion.attributes["warnings"] + modes.attributes["warnings"],
        "seconds": seconds,
    }


def _ringing(
    frequencies_hz: np.ndarray, dampings_per_s: np.ndarray, eigenvalues: np.ndarray
) -> dict[str, Any]:
    """Return frequencies, dampings, loss factors and times for 60 dB of the modes, as JSON has them."""
    dampings = dampings_per_s.tolist()
    return {
        "frequencies_hz": frequencies_hz.tolist(),
        "dampings_per_s": dampings,
        "t60_s": [math.log(1000) / damping if damping > 0 else None for damping in dampings],
        "loss_factors": (2 * dampings_per_s / np.sqrt(eigenvalues)).tolist(),
    }


def _listed(values: np.ndarray | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _stored_modes(file: ObjectFile) -> dict[str, Any]:
    text = file.description
    return {
        "material": text["material"]["name"] if text["material"] else "unknown material",
        "damping": file.modes.damping,
        **_ringing(file.modes.frequencies_hz, file.modes.dampings_per_s, file.modes.eigenvalues),
        "radiation_dampings_per_s": _listed(file.modes.radiation_dampings_per_s),
        "frequency_limit_hz": text["audio"]["frequency_limit_hz"],
        "error_estimate_cents": ((text["fidelity"] or {}).get("audio") or {}).get(
            "solver_error_estimate_cents"
        ),
    }


def _cell(name: str, value: float | None) -> str:
    if value is None:
        return "unknown"
    return f"{value:.2g}" if name == "loss_factors" else f"{value:.2f}"


def _damping_line(stated: dict[str, Any], radiation: list[float] | None) -> str:
    numbers = ", ".join(f"{name} {value:g}" for name, value in stated.items() if name != "law")
    law = "eta(f) of its material" if stated["law"] == LOSS_FACTOR else "Rayleigh's law"
    air = "" if radiation is None else ", and what each mode radiates"
    return f"damping: {law}" + (f" ({numbers})" if numbers else "") + air


def modes_table(result: dict[str, Any]) -> str:
    """Return the result of `solve_modes` for people."""
    count, limit_hz = len(result["frequencies_hz"]), result["frequency_limit_hz"]
    lines = [f"{counted(count, 'mode')} below {limit_hz:.0f} Hz in {result['material']}"]
    if count:
        every = ("frequencies_hz", "dampings_per_s", "t60_s", "loss_factors", "error_estimates_cents")
        names = [name for name in every if name in result]
        rows = zip(*([_cell(name, value) for value in result[name]] for name in names), strict=True)
        table = [(str(number), *row) for number, row in enumerate(rows)]
        lines += columns([("", *names), *table], texts=0)
    lines.append(_damping_line(result["damping"], result["radiation_dampings_per_s"]))
    if "count_certificate" not in result:
        cents = result["error_estimate_cents"]
        return "\n".join([*lines, f"error: {'unknown' if cents is None else f'about {cents:.1f} cents'}"])
    certificate = result["count_certificate"]
    lines.append(
        f"count: {certificate['counted']} eigenvalues below the limit = {certificate['rigid']} rigid + "
        f"{certificate['elastic_found']} found ({certificate['method']})"
    )
    over, under = certificate["found_within_error_below_limit"], certificate["left_within_error_above_limit"]
    if over or under:
        lines.append(f"near the limit: {over} of them may lie above it, {under} others below it")
    geometry = result["geometry_error_estimate_cents"]
    if geometry is not None:
        lines.append(
            f"shape: the error of the solid's mean wall changes frequencies by about {geometry:.1f} cents"
        )
    lines += result["warnings"]
    seconds = ", ".join(f"{name} {value:.1f}" for name, value in result["seconds"].items())
    return "\n".join([*lines, f"CPU seconds: {seconds}"])
