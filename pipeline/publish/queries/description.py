"""The contents and the fidelity of an Object File, in lines for people."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.making.mesh.body import told_normals
from objectfolder.object_file import ObjectFile
from objectfolder.vision.appearance import THIN
from pipeline.dataset.counts import counted
from pipeline.dataset.measures import (
    CONDITION_LABELS,
    CONTACT,
    FOREGROUND,
    FULL_IMAGE,
    GAIN,
    IN_CONDITIONS,
    SIMILARITY,
)


def info_lines(file: ObjectFile, path: Path) -> list[str]:
    """Return what a file holds."""
    statement = file.description["object"]
    modes = file.modes.frequencies_hz
    parts = ", ".join(f"{name} {count}" for name, count in file.bytes_by_part().items())
    silent = "no sound" if file.modes.absent else "no audible mode"
    sound = f"{counted(len(modes), 'mode')}, {modes[0]:.1f} to {modes[-1]:.1f} Hz" if len(modes) else silent
    sight = "computed from the material" if file.vision.computed else "learned from views"
    sight = "computed as thin glass" if file.vision.glass == THIN else sight
    return [
        f"{statement['name']} ({statement['id']}), {file.description['material']['name']}",
        f"licence      {statement['licence']}; {statement['attribution']}",
        f"size         {' x '.join(f'{side:.4g}' for side in np.ptp(file.surface.bounds, axis=0))} m",
        f"surface      {len(file.surface.faces)} triangles",
        *_body(file),
        f"sight        {sight}",
        f"sound        {sound}",
        f"bytes        {path.stat().st_size} ({parts})",
        *fidelity_lines(file),
    ]


def fidelity_lines(file: ObjectFile) -> list[str]:
    """Return the file's own fidelity on held-out queries, a line a sense."""
    fidelity = file.description.get("fidelity")
    if not fidelity:
        return ["fidelity     not measured"]
    vision, audio, touch = fidelity["vision"], fidelity["audio"], fidelity["touch"]
    words = "no sound" if audio.get("absent") else "no audible mode"
    if audio["audible"]:
        words = (
            f"gain error {audio[GAIN.name]:.1f} dB, "
            f"frequencies within {audio['frequency_error_cents']:.2g} cents of the solver, "
            f"solver within about {_number(audio['solver_error_estimate_cents'])} cents"
        )
    return [
        f"vision       PSNR of the foreground {_number(vision[FOREGROUND.name])} dB, "
        f"of the full image {vision[FULL_IMAGE.name]:.2f} dB, "
        f"SSIM {vision[SIMILARITY.name]:.4f} ({vision['held_out_views']} held-out views)",
        *_condition_lines(fidelity),
        f"audio        {words}",
        f"touch        PSNR {touch['psnr_db']:.2f} dB, in contact {_number(touch[CONTACT.name])} dB "
        f"({touch['held_out_touches']} held-out touches); "
        f"{100 * touch['unreachable_share']:.0f} % of the surface out of the sensor's reach",
    ]


def _condition_lines(fidelity: Mapping[str, Any]) -> list[str]:
    """Return the figures of views in other conditions, each with noise floor and trivial answer."""
    return [
        f"             {label}: PSNR of the foreground {_number(measure.of(fidelity))} dB "
        f"(noise floor {_number(measure.noise_floor_of(fidelity))}, "
        f"trivial {_number(measure.trivial_of(fidelity))})"
        for measure, label in zip(IN_CONDITIONS, CONDITION_LABELS.values(), strict=True)
        if measure.of(fidelity) is not None
    ]


def _body(file: ObjectFile) -> list[str]:
    body = file.description["body"]
    if not body:
        return []
    closure = "watertight" if body["watertight"] else "open: mass of the filled solid"
    masses = [mass for mass in (body["mass_kg"], body["filled_mass_kg"]) if mass is not None]
    mass = f"{masses[0]:.4g} kg" if masses else "mass unknown"
    wall = "unknown" if body["wall_median_m"] is None else f"{body['wall_median_m'] * 1e3:.2g} mm"
    warnings = [f"warning      {warning}" for warning in body.get("warnings") or []]
    return [
        f"body         {mass} ({closure}), pieces {body['components']}, median wall {wall}, "
        f"normals {told_normals(body.get('normals_of_source', 0.0))}"
        + (f", {body['source_up']} of the source became z" if "source_up" in body else ""),
        *warnings,
    ]


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.1f}"
