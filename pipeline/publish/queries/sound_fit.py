"""A material fitted to recordings of a real object, as JSON, as lines and as a row of a table."""

import csv
import io
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.materials import find_material, read_materials
from objectfolder.products.atomic import write_whole
from pipeline.dataset.counts import columns, counted
from pipeline.publish.queries.requests import FittingOfSound

# Of the highest partial, up to which modes are solved: an object may be softer than the table says.
BAND = 1.1


def fit_sounds(
    files: Sequence[Path], request: FittingOfSound, show: Callable[[str], None] = lambda line: None
) -> dict[str, Any]:
    """Return what recordings tell of the material of a mesh, as JSON has it.

    Parameters
    ----------
    files
        Recordings, then the mesh. A recording that cannot be used is named, and the others are used.
    show
        Called with each step, for people.

    Raises
    ------
    InputError
        No recording that can be used, a mesh or material that cannot, or recordings of another object.
    SimulationError
        The solver did not reach its accuracy.
    """
    if len(files) < 2:
        raise InputError(
            "fit-sound", f"{counted(len(files), 'file')} given", "Give recordings, then the mesh."
        )
    *paths, mesh = files
    materials = read_materials(request.materials)
    if request.material is None:
        raise InputError("--material", "not given", f"Begin from one of {', '.join(sorted(materials))}.")
    material = find_material(materials, request.material, str(request.materials))
    from objectfolder.making.mesh.ingest import ingest_object
    from objectfolder.making.recordings.body import solve_body
    from objectfolder.making.recordings.fitting import (
        FEWEST_SHARE,
        LEAST_ALONE_CENTS,
        fit_body,
        fitted_material,
        partials_near_modes,
    )
    from objectfolder.making.recordings.partials import partials_of, partials_over
    from objectfolder.making.recordings.recording import read_recording
    from objectfolder.surface.textured_mesh import textured_mesh_of

    start_s = time.process_time()
    recordings, own, names, warnings = [], [], [], []
    for path in paths:
        show(f"finding the partials of {path}")
        try:
            recording = read_recording(path)
            partials = partials_of(recording, request.max_frequency_hz)
        except InputError as error:
            warnings.append(f"left out: {error}")
            continue
        warnings += [f"{recording.name}: {fault}" for fault in recording.warnings]
        short = np.count_nonzero(~partials.decay_is_measured)
        if short:
            warnings.append(
                f"{recording.name}: {len(recording.decay) / recording.sample_rate_hz:.2f} s after the strike "
                f"{short} of {len(partials)} partials have fallen by less than 10 dB (least: "
                f"{partials.fall_db.min():.0f}): their decays are not used"
            )
        recordings.append(recording)
        own.append(partials)
        names.append(recording.name)
    if not recordings:
        raise InputError("recordings", "; ".join(warnings).removesuffix("."), "Give one that can be used.")
    partials = own[0] if len(own) == 1 else partials_over(recordings, own, request.max_frequency_hz)
    seconds = {"recordings": time.process_time() - start_s}
    if not len(partials):
        raise InputError("recordings", "no partial in them", "Strike harder, or record nearer.")
    show(f"solving the modes of {mesh}")
    ingestion = ingest_object(mesh, length_m=request.length_m, object_id=mesh.stem, with_textures=False)
    body = solve_body(
        textured_mesh_of(ingestion).surface,
        material,
        BAND * min(float(partials.frequencies_hz.max()), request.max_frequency_hz),
        wall_m=request.wall_m,
        shell_m=request.shell_m,
        accuracy_cents=request.accuracy_cents,
        max_modes=request.max_modes,
        seed=request.seed,
        name=mesh.name,
    )
    fitting = time.process_time()
    fit = fit_body(
        partials, body, recordings=len(recordings), fit_wall=not request.hold_wall, seed=request.seed
    )
    seconds |= {
        "solve": body.solve_s,
        "derivatives": body.derivatives_s,
        "fit": time.process_time() - fitting,
    }
    for name, recording_partials in zip(names, own, strict=True):
        near = partials_near_modes(recording_partials, fit)
        if near < FEWEST_SHARE * len(recording_partials):
            warnings.append(
                f"{name}: {near} of {len(recording_partials)} partials are within {LEAST_ALONE_CENTS:.0f} "
                "cents of a mode of the fit: is it of another object?"
            )
    if fit.decay is None:
        warnings.append(
            "too few decays are long enough to be measured: the material gets no loss factor of its own"
        )
    matches = fit.matching
    alone = np.setdiff1d(np.arange(len(partials)), matches.partials)
    spread_cents = 1200 * np.log2(1 + partials.frequency_spread_hz / partials.frequencies_hz)
    citation = (
        f"fitted to {len(names)} recordings of a strike ({', '.join(names)}) and {mesh.name}: "
        f"{len(matches.modes)} partials to {matches.rms_cents:.1f} cents rms, walls {fit.wall.value:.4f} "
        "of the mesh's"
    )
    return {
        "recordings": names,
        "warnings": ingestion.attributes["warnings"] + warnings,
        "matched": [
            {
                "partial_hz": float(partials.frequencies_hz[partial]),
                "recordings": int(partials.recordings[partial]),
                "spread_cents": float(spread_cents[partial]),
                "mode": int(mode),
                "mode_hz": float(body.frequencies_hz[mode]),
                "cents_before": float(before),
                "cents": float(cents),
                "decay_per_s": float(decay),
                "decay_spread_per_s": float(partials.decay_spread_per_s[partial]),
                "decay_is_measured": bool(partials.decay_is_measured[partial]),
            }
            for partial, mode, before, cents, decay in zip(
                matches.partials,
                matches.modes,
                fit.cents_before,
                matches.cents,
                fit.decays_per_s,
                strict=True,
            )
        ],
        "unmatched_partials_hz": partials.frequencies_hz[alone].tolist(),
        "unheard_modes_hz": np.delete(fit.modes_hz, matches.modes).tolist(),
        "rms_cents_before": float(np.sqrt(np.mean(fit.cents_before**2))),
        "rms_cents": matches.rms_cents,
        "stiffness_over_density": _estimate(fit.stiffness),
        "poisson_ratio": _estimate(fit.poisson_ratio),
        "wall_over_mesh": _estimate(fit.wall) | {"held": request.hold_wall},
        "wall_m": body.wall_m * fit.wall.value,
        "decay_factor_rms": None if fit.decay is None else fit.decay.factor,
        "chance": fit.chance,
        "from_material": material.name,
        "material": fitted_material(fit, body, request.name or mesh.stem.lower(), citation, request.mass_kg),
        "seconds": seconds,
    }


def _estimate(estimate: Any) -> dict[str, Any]:
    return {"value": estimate.value, "deviation": estimate.deviation, "visible": estimate.visible}


def fit_lines(result: Mapping[str, Any]) -> str:
    """Return the result of `fit_sounds` for people."""
    head = ("partial Hz", "in", "spread", "mode Hz", "before", "after", "decay 1/s (spread)")
    rows = [
        (
            f"{row['partial_hz']:.2f}", str(row["recordings"]), f"{row['spread_cents']:.2f}",
            f"{row['mode_hz']:.2f}", f"{row['cents_before']:.1f}", f"{row['cents']:.1f}",
            f"{row['decay_per_s']:.1f} ({row['decay_spread_per_s']:.1f})"
            if row["decay_is_measured"]
            else "not measured",
        )
        for row in result["matched"]
    ]  # fmt: skip
    lines = columns([head, *rows], texts=0)
    count = len(result["matched"])
    alone, unheard = result["unmatched_partials_hz"], result["unheard_modes_hz"]
    lines.append(
        f"{count} of {count + len(alone)} partials matched: {result['rms_cents_before']:.1f} cents rms "
        f"before, {result['rms_cents']:.1f} after; random partials reach {result['chance']:.0%} of the weight"
    )
    lines.append(f"partials without a mode of their own: {_frequencies(alone)}")
    lines.append(f"modes not heard: {_frequencies(unheard)}")
    row = result["material"]
    lines.append(
        f"E / rho      {_printed(result['stiffness_over_density'])} of {result['from_material']}'s"
        f" (E {float(row['youngs_modulus_pa']):.4g} Pa at {float(row['density_kg_m3']):.4g} kg/m3)"
    )
    lines.append(f"nu           {_printed(result['poisson_ratio'])}")
    wall = (
        "held" if result["wall_over_mesh"]["held"] else f"{_printed(result['wall_over_mesh'])} of the mesh's"
    )
    lines.append(f"walls        {wall}, {result['wall_m'] * 1e3:.2f} mm in the mean")
    if result["decay_factor_rms"] is not None:
        lines.append(
            f"loss factor  {row['loss_factor']} at 1 kHz, times (f / 1 kHz)^{row['loss_exponent']}: "
            f"decays are within a factor {result['decay_factor_rms']:.2f} rms"
        )
    lines += [f"warning      {warning}" for warning in result["warnings"]]
    seconds = ", ".join(f"{name} {value:.1f}" for name, value in result["seconds"].items())
    return "\n".join([*lines, f"CPU seconds: {seconds}"])


def _printed(estimate: Mapping[str, Any]) -> str:
    if estimate["visible"]:
        return f"{estimate['value']:.4f} +- {estimate['deviation']:.4f}"
    return f"{estimate['value']:.4g}, as before: not visible in these partials"


def _frequencies(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.0f}" for value in values) or "none"


def write_row(path: Path, row: Mapping[str, str]) -> None:
    """Write a table of materials with one row."""
    text = io.StringIO()
    table = csv.DictWriter(text, row.keys(), lineterminator="\n")
    table.writeheader()
    table.writerow(row)
    write_whole(path, text.getvalue().encode())
