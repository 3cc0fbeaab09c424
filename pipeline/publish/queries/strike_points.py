"""Strikes of an Object File, written as float WAV files."""

from pathlib import Path

import numpy as np

import objectfolder
from objectfolder.audio.materials import find_material, read_materials
from objectfolder.audio.synthesis import ContactBody, write_wav
from pipeline.publish.queries.query_files import made_folder, read_numbers
from pipeline.publish.queries.requests import Striking


def strike_points(
    path: Path,
    wanted: Striking,
    output: Path,
    pulse_s: float | None = None,
    striker: tuple[str, float, float] | None = None,
) -> str:
    """Strike a file of contacts, a WAV file each; return what was done, in a line.

    Parameters
    ----------
    path
        The Object File.
    wanted
        Points, forces and options.
    output
        Folder for the sounds.
    pulse_s
        Length of a half sine in which an impulse is spent, seconds.
    striker
        Or what strikes: material, radius at the contact (m) and mass (kg).

    Raises
    ------
    InputError
        A file or an option that cannot be used.
    QueryError
        What the Object File cannot answer.
    """
    file = objectfolder.load(path)
    points = read_numbers(wanted.points, (3,))
    parts = file.strikes(
        points,
        read_numbers(wanted.forces, (3,), (2, 3)),
        wanted.duration_s,
        wanted.sample_rate_hz,
        pulse=_body(wanted.materials, *striker) if striker else pulse_s,
        listener=np.array(wanted.listener) if wanted.listener else None,
    )
    folder = made_folder(output)
    peak = 0.0
    for rows, sounds in parts:
        for index, sound in zip(range(rows.start, rows.stop), sounds, strict=True):
            write_wav(folder / f"{index:04d}.wav", sound, wanted.sample_rate_hz, gain=wanted.gain)
        peak = max(peak, float(np.abs(sounds).max(initial=0.0)))
    unit = "Pa" if wanted.listener else "m/s"
    written = "" if wanted.gain == 1 else f", written times {wanted.gain:g}"
    return f"{folder}: {len(points)} sounds of {wanted.duration_s} s, peak {peak:.3g} {unit}{written}"


def _body(materials: Path, name: str, radius_m: float, mass_kg: float) -> ContactBody:
    material = find_material(read_materials(materials), name, str(materials))
    return ContactBody(material.youngs_modulus_pa, material.poisson_ratio, radius_m, mass_kg)
