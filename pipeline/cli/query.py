"""Commands that ask an Object File: info, sample, render, strike, press."""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

import objectfolder
from objectfolder.audio.synthesis import ContactBody
from objectfolder.errors import InputError
from objectfolder.object_file import ObjectFile
from pipeline.cli import render as rendering

MATERIALS = Path(__file__).parents[2] / "data" / "materials.csv"


def add_commands(commands: Any) -> None:
    """Add the commands of this module to a parser's sub-commands."""
    info = _command(commands, "info", show, "print what an Object File holds and how faithful it is")
    info.add_argument("--json", action="store_true", help="print the whole description as JSON")

    sampled = _command(commands, "sample", sample, "draw valid queries and write them as .npy files")
    sampled.add_argument("--views", type=int, default=8, help="number of views (default 8)")
    sampled.add_argument("--contacts", type=int, default=8, help="number of contacts (default 8)")
    sampled.add_argument("--seed", type=int, default=0, help="seed of the draw (default 0)")
    _output(sampled, "folder for views.npy, points.npy and forces.npy")

    rendered = _command(commands, "render", render, "render views to PNG")
    rendering.add_arguments(rendered)
    _output(rendered, "folder for 0000.png and so on")

    struck = _command(commands, "strike", strike, "strike points and write float WAV files")
    struck.add_argument("--points", required=True, metavar="POINTS.npy", help="(n, 3) metres, object frame")
    struck.add_argument(
        "--forces",
        required=True,
        metavar="FORCES.npy",
        help="(n, 3) impulses, newton seconds; or (n, k, 3) newtons at the samples",
    )
    struck.add_argument("--duration", type=float, default=2.0, help="seconds (default 2)")
    struck.add_argument("--sample-rate", type=int, default=44100, help="hertz (default 44100)")
    contact = struck.add_mutually_exclusive_group()
    contact.add_argument(
        "--pulse", type=float, metavar="SECONDS", help="spend each impulse as half a sine of this length"
    )
    contact.add_argument(
        "--striker",
        nargs=3,
        metavar=("MATERIAL", "RADIUS", "MASS"),
        help="what strikes: a row of the materials table, its radius at the contact (m) and its mass (kg); "
        "the length of the pulse is that of the Hertz contact",
    )
    struck.add_argument(
        "--listener",
        nargs=3,
        type=float,
        action="append",
        metavar=("X", "Y", "Z"),
        help="write the pressure there (Pa, approximate), not surface velocity (m/s); metres, object frame; "
        "twice for stereo",
    )
    struck.add_argument("--gain", type=float, default=1.0, help="factor of what is written (default 1)")
    struck.add_argument("--materials", default=str(MATERIALS), help="materials table (CSV)")
    _output(struck, "folder for 0000.wav and so on")

    pressed = _command(commands, "press", press, "press the sensor and write PNG images and depth maps")
    pressed.add_argument("--points", required=True, metavar="POINTS.npy", help="(n, 3) metres, object frame")
    goal = pressed.add_mutually_exclusive_group()
    goal.add_argument("--depth", type=float, help="metres into the gel (default 0.001)")
    goal.add_argument("--force", type=float, help="newtons along the sensor's axis; the gel is elastic then")
    pressed.add_argument("--tilt", type=float, default=0.0, help="degrees from the normal (default 0)")
    pressed.add_argument(
        "--azimuth", type=float, default=0.0, help="degrees from the image's right to its top (default 0)"
    )
    pressed.add_argument(
        "--contact", choices=("rigid", "elastic"), help="contact model (default: the file's own)"
    )
    pressed.add_argument(
        "--resolution", nargs=2, type=int, metavar=("HEIGHT", "WIDTH"), help="pixels (default: the sensor's)"
    )
    pressed.add_argument(
        "--background",
        metavar="IMAGE",
        help="image of a real sensor that nothing touches, to lay the touches over; 'synthetic' draws one",
    )
    pressed.add_argument("--noise-seed", type=int, help="add the sensor's noise (default: none)")
    _output(pressed, "folder for 0000.png, depth.npy and labels.json")


def show(options: argparse.Namespace) -> None:
    """Print a file's description."""
    file = objectfolder.load(options.file)
    if options.json:
        print(json.dumps({**file.description, "bytes": file.bytes_by_part()}, indent=2, ensure_ascii=False))
        return
    said = file.description["object"]
    modes = file.modes.frequencies_hz
    print(f"{said['name']} ({said['id']}), {file.description['material']['name']}")
    print(f"licence      {said['licence']}; {said['attribution']}")
    print(f"size         {' x '.join(f'{side:.4g}' for side in np.ptp(file.surface.bounds, axis=0))} m")
    print(f"surface      {len(file.surface.faces)} triangles")
    if body := file.description["body"]:
        closed = "watertight" if body["watertight"] else "open: mass of the filled solid"
        mass = body["mass_kg"] if body["mass_kg"] is not None else body["filled_mass_kg"]
        wall = "unknown" if body["wall_median_m"] is None else f"{body['wall_median_m'] * 1e3:.2g} mm"
        print(f"body         {mass:.4g} kg ({closed}), pieces {body['components']}, median wall {wall}")
        for warning in body.get("warnings") or []:
            print(f"warning      {warning}")
    sound = f"{len(modes)} modes, {modes[0]:.1f} to {modes[-1]:.1f} Hz" if len(modes) else "no audible mode"
    print(f"sound        {sound}")
    print(f"bytes        {Path(options.file).stat().st_size} ({_pairs(file.bytes_by_part())})")
    for line in fidelity_lines(file):
        print(line)


def fidelity_lines(file: ObjectFile) -> list[str]:
    """Return the file's own fidelity on held-out queries, a line a sense."""
    fidelity = file.description.get("fidelity")
    if not fidelity:
        return ["fidelity     not measured"]
    vision, audio, touch = fidelity["vision"], fidelity["audio"], fidelity["touch"]
    heard = "no audible mode"
    if audio["audible"]:
        heard = (
            f"gain error {audio['gain_error_db']:.1f} dB, "
            f"frequencies within {audio['frequency_error_cents']:.2g} cents of the solver, "
            f"solver within about {_number(audio['solver_error_estimate_cents'])} cents"
        )
    return [
        f"vision       PSNR {vision['psnr_db']:.2f} dB, foreground {vision['psnr_foreground_db']:.2f} dB, "
        f"SSIM {vision['ssim']:.4f} ({vision['held_out_views']} held-out views)",
        f"audio        {heard}",
        f"touch        PSNR {touch['psnr_db']:.2f} dB, in contact {_number(touch['psnr_contact_db'])} dB "
        f"({touch['held_out_touches']} held-out touches); "
        f"{100 * touch['unreachable_share']:.0f} % of the surface out of the sensor's reach",
    ]


def sample(options: argparse.Namespace) -> None:
    """Write valid queries: views in the unit frame as the published tools have them, contacts in metres."""
    file = objectfolder.load(options.file)
    cameras, lights = file.sample_views(options.views, options.seed)
    points, normals = file.sample_contacts(options.contacts, options.seed)
    folder = _folder(options.output)
    views = np.concatenate([file.frame.to_unit(cameras[:, :3, 3]), file.frame.to_unit(lights)], axis=1)
    np.save(folder / "views.npy", views)
    np.save(folder / "points.npy", points)
    np.save(folder / "forces.npy", -normals)
    print(f"{folder}: views.npy {views.shape}, points.npy and forces.npy {points.shape} (1 N s inwards)")


def render(options: argparse.Namespace) -> None:
    """Render a file of views to PNG."""
    rendering.render(options, _folder(options.output))


def strike(options: argparse.Namespace) -> None:
    """Strike a file of contacts and write one float WAV each."""
    from objectfolder.audio.synthesis import write_wav

    file = objectfolder.load(options.file)
    points, forces = _read(options.points, 3), _read(options.forces, 3, sampled=True)
    parts = file.strikes(
        points,
        forces,
        options.duration,
        options.sample_rate,
        pulse=_striker(options) if options.striker else options.pulse,
        listener=options.listener,
    )
    folder = _folder(options.output)
    peak = 0.0
    for rows, sounds in parts:
        for index, sound in zip(range(rows.start, rows.stop), sounds, strict=True):
            write_wav(folder / f"{index:04d}.wav", sound, options.sample_rate, gain=options.gain)
        peak = max(peak, float(np.abs(sounds).max(initial=0.0)))
    unit = "Pa" if options.listener else "m/s"
    written = "" if options.gain == 1 else f", written times {options.gain:g}"
    print(f"{folder}: {len(points)} sounds of {options.duration} s, peak {peak:.3g} {unit}{written}")


def _striker(options: argparse.Namespace) -> ContactBody:
    """Return the body that strikes."""
    from objectfolder.audio.materials import find_material, read_materials

    name, *numbers = options.striker
    material = find_material(read_materials(options.materials), name, options.materials)
    try:
        radius, mass = (float(number) for number in numbers)
    except ValueError:
        raise InputError(
            "--striker",
            f"{' '.join(numbers)}: not numbers",
            "Give MATERIAL RADIUS MASS, metres and kilograms.",
        ) from None
    return ContactBody(material.youngs_modulus_pa, material.poisson_ratio, radius, mass)


def press(options: argparse.Namespace) -> None:
    """Press at a file of points; write images, depth maps and labels."""
    from PIL import Image

    from objectfolder.touch.calibrated import synthetic_background

    file = objectfolder.load(options.file)
    sensor = file.touch.sensor
    resolution = tuple(options.resolution or (sensor.image_height, sensor.image_width))
    background = None
    if options.background == "synthetic":
        background = synthetic_background(sensor.at_resolution(*resolution), options.noise_seed or 0)
    elif options.background:
        background = _background(options.background, resolution)
    touches = file.press(
        _read(options.points, 3),
        options.depth,
        options.tilt,
        options.azimuth,
        force=options.force,
        contact=options.contact,
        resolution=resolution,
        background=background,
        noise_seed=options.noise_seed,
    )
    folder = _folder(options.output)
    for index, image in enumerate(touches.rgb):
        Image.fromarray(image).save(folder / f"{index:04d}.png")
    np.save(folder / "depth.npy", touches.depth)
    labels = {
        "reachable": touches.reachable.tolist(),
        "penetration_m": touches.penetration_m.tolist(),
        "first_contact_offset_m": touches.first_contact_offset_m.tolist(),
        "contact_area_m2": touches.contact_area_m2.tolist(),
        "force_n": [None if np.isnan(force) else float(force) for force in touches.force_n],
        "saturated": touches.saturated.tolist(),
        "sensor_to_object": touches.sensor_to_object.tolist(),
    }
    (folder / "labels.json").write_text(json.dumps(labels, indent=1))
    print(f"{folder}: {len(touches.rgb)} touches, {int(touches.reachable.sum())} reachable")


def _background(path: str, resolution: tuple[int, int]) -> np.ndarray:
    """Read an image (height, width, 3) of any size at a resolution (height, width)."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            resized = image.convert("RGB").resize(resolution[::-1], Image.Resampling.BILINEAR)
    except OSError as error:
        raise InputError(path, f"not an image ({error})", "Give a picture for --background.") from error
    return np.asarray(resized)


def _command(commands: Any, name: str, run: Any, text: str) -> argparse.ArgumentParser:
    command: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text)
    command.add_argument("file", metavar="FILE.safetensors", help="an Object File")
    command.set_defaults(run=run)
    return command


def _output(command: argparse.ArgumentParser, text: str) -> None:
    command.add_argument("-o", "--output", required=True, help=text)


def _folder(path: str) -> Path:
    folder = Path(path)
    if folder.exists() and not folder.is_dir():
        raise InputError(str(folder), "is a file", "Give a folder for --output.")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _read(path: str, columns: int, *, sampled: bool = False) -> np.ndarray:
    """Read an (n, columns) array of finite numbers from an .npy file; pickles are refused.

    With `sampled` it may be (n, k, columns).
    """
    try:
        values = np.load(path, allow_pickle=False)
    except ValueError as error:
        raise InputError(
            path, f"not an .npy file of numbers ({error})", "Write it with numpy.save."
        ) from error
    dimensions = (2, 3) if sampled else (2,)
    if (
        values.ndim not in dimensions
        or values.shape[-1] != columns
        or not np.issubdtype(values.dtype, np.number)
    ):
        raise InputError(path, f"shape {values.shape}", f"Give an (n, {columns}) array.")
    if not np.isfinite(values).all():
        raise InputError(path, "holds values that are not finite", "Give numbers.")
    return np.asarray(values, dtype=np.float64)


def _pairs(values: dict[str, int]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.1f}"
