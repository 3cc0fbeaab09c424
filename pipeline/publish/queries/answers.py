"""Queries from files, asked of an Object File, and the answers written to a folder.

Each function returns a summary in figures. It raises `InputError` for a file or an option that cannot
be used, and `QueryError` for what the Object File cannot answer.
"""

import functools
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import objectfolder
from objectfolder.audio.synthesis import ContactBody, listening_gain, write_wav
from objectfolder.errors import InputError
from objectfolder.making.materials import find_material, read_materials
from objectfolder.object_file import ObjectFile
from objectfolder.products.regular_file import open_regular, read_regular, require_regular
from objectfolder.query_values import real
from objectfolder.touch.sensor.reading import synthetic_background
from objectfolder.vision.cameras import look_at
from objectfolder.vision.environment import Environment
from objectfolder.vision.lamps import Lamps
from pipeline.publish.queries.requests import Beater, Pressing, Rendering, Striking
from pipeline.publish.queries.summaries import PressSummary, RenderSummary, SampleSummary, StrikeSummary

LABELS = ("reachable", "penetration_m", "first_contact_offset_m", "contact_area_m2", "force_n", "saturated",
          "sensor_to_object")  # fmt: skip

SPEEDS_M_S = (1e-6, 1e4)
VIEWS, FRAMES = 8, 24  # where no number is named: views, and pictures of a turntable


def sample_queries(
    path: Path, views: int, contacts: int, seed: int, anywhere: bool, output: Path
) -> SampleSummary:
    """Write valid queries, in metres of the object frame; contacts `anywhere` need not be reachable."""
    file = objectfolder.load(path)
    cameras, lights = file.sample_views(views, seed)
    points, normals = file.sample_contacts(contacts, seed, reachable=not anywhere)
    queries = np.concatenate([cameras[:, :3, 3], lights], axis=1)
    output.mkdir(parents=True, exist_ok=True)
    np.save(output / "views.npy", queries)
    np.save(output / "points.npy", points)
    np.save(output / "forces.npy", -normals)
    return SampleSummary(folder=str(output), views=len(queries), contacts=len(points))


def render_views(path: Path, request: Rendering, output: Path) -> RenderSummary:
    """Render views to PNG, further passes to PNG and .npy."""
    if request.turntable:
        return _turntable(path, request, output)
    file = objectfolder.load(path)
    lights = _lights(request, file)
    if not isinstance(request.views, Path):
        count = VIEWS if request.views is None else request.views
        cameras, lamps = file.sample_views(count, request.seed)
    else:
        columns = (6,) if lights is None else (3, 6)
        views = _read_numbers(request.views, columns, remedy="Give an (n, 6) array, or (n, 3) with --light.")
        positions = _in_object_frame(views.reshape(len(views), -1, 3), request, file)
        cameras, lamps = look_at(positions[:, 0], file.frame.centre), positions[:, -1]
    output.mkdir(parents=True, exist_ok=True)
    for index, (camera, lamp) in enumerate(zip(cameras, lamps, strict=True)):
        passes = file.render_passes(
            camera,
            ["image", *request.passes],
            lamp if lights is None else lights,
            request.resolution,
            field_of_view_deg=request.field_of_view_deg,
            sub_rays=request.sub_rays,
            crop=request.crop,
        )
        Image.fromarray(passes["image"][0]).save(output / f"{index:04d}.png")
        for name in request.passes:
            if name == "mask":
                Image.fromarray(passes[name][0].astype(np.uint8) * 255).save(output / f"{index:04d}_mask.png")
            else:
                np.save(output / f"{index:04d}_{name}.npy", passes[name][0])
    return _summary(file, request, output, len(cameras))


def _summary(file: ObjectFile, request: Rendering, output: Path, images: int) -> RenderSummary:
    _, _, height, width = request.crop or (0, 0, request.resolution, request.resolution)
    return RenderSummary(
        folder=str(output),
        images=images,
        height=height,
        width=width,
        passes=request.passes,
        lights=len(request.light),
        turntable=request.turntable,
    )


def _turntable(path: Path, request: Rendering, output: Path) -> RenderSummary:
    """Write pictures from all round, and a GIF that turns the object once in three seconds."""
    if isinstance(request.views, Path) or request.light or request.environment or request.passes:
        finding = "has its own cameras and light"
        raise InputError("--turntable", finding, "Give a number of --views with it, and no light or passes.")
    file = objectfolder.load(path)
    count = FRAMES if request.views is None else request.views
    output.mkdir(parents=True, exist_ok=True)
    pictures = [Image.fromarray(pixels) for pixels in file.pictures(count, request.resolution)]
    for index, picture in enumerate(pictures):
        picture.save(output / f"{index:04d}.png")
    if pictures:
        pause_ms = max(20, 3000 // len(pictures))
        pictures[0].save(
            output / "turntable.gif", save_all=True, append_images=pictures[1:], duration=pause_ms, loop=0
        )
    return _summary(file, request, output, len(pictures))


def strike_points(
    path: Path,
    request: Striking,
    output: Path,
    pulse_s: float | None,
    striker: tuple[str, float, float] | Beater | None,
) -> StrikeSummary:
    """Write a float WAV file for each contact, all times one gain, so that louder stays louder.

    The pulse is a half sine of `pulse_s` seconds, or that of a striker: material, radius at the contact
    (m), mass (kg), or its name.
    """
    file = objectfolder.load(path)
    if striker is None and pulse_s is None and request.forces is None:
        striker = "wood"
    body: ContactBody | str | None = None
    if isinstance(striker, str) and striker != "impulse":
        body = striker
    elif isinstance(striker, tuple):
        name, radius_m, mass_kg = striker
        material = find_material(read_materials(request.materials), name, str(request.materials))
        body = ContactBody(material.youngs_modulus_pa, material.poisson_ratio, radius_m, mass_kg)
    points, normals = _contacts(file, request.points, request.seed, reachable=False)
    impulses, forces = _pushes(normals, request.forces)
    velocities = None
    if body and request.forces is None:
        speed_m_s = real("--speed", request.speed_m_s, *SPEEDS_M_S, " m/s")
        impulses, velocities = None, -speed_m_s * normals
    strikes = functools.partial(
        file.strikes,
        points,
        impulses,
        duration_s=request.duration_s,
        sample_rate_hz=request.sample_rate_hz,
        forces_n=forces,
        velocities_m_s=velocities,
        pulse=body or pulse_s,
        listener=np.array(request.listener) if request.listener else None,
        support=None if request.support == "free" else request.support,
    )
    peak = max((float(np.abs(sounds).max(initial=0.0)) for _, sounds in strikes()), default=0.0)
    gain = listening_gain(peak) if request.gain is None else request.gain
    output.mkdir(parents=True, exist_ok=True)
    for rows, sounds in strikes():  # again: all at once need not fit in memory
        for index, sound in zip(range(rows.start, rows.stop), sounds, strict=True):
            write_wav(output / f"{index:04d}.wav", sound, sample_rate_hz=request.sample_rate_hz, gain=gain)
    return StrikeSummary(
        folder=str(output),
        sounds=len(points),
        duration_s=request.duration_s,
        sample_rate_hz=request.sample_rate_hz,
        peak=peak,
        unit="Pa" if request.listener else "m/s",
        gain=float(gain),
        gain_by_peak=request.gain is None,
    )


def press_points(
    path: Path, request: Pressing, output: Path, depth_m: float | None, force_n: float | None
) -> PressSummary:
    """Write an image of each touch, depth.npy and labels.json; a force makes the gel elastic."""
    file = objectfolder.load(path)
    sensor = file.touch.sensor
    resolution = request.resolution or (sensor.image_height, sensor.image_width)
    touches = file.press(
        _contacts(file, request.points, request.seed, reachable=not request.anywhere)[0],
        depth_m,
        request.tilt_deg,
        request.azimuth_deg,
        roll_deg=request.roll_deg,
        force_n=force_n,
        contact=request.contact,
        resolution=resolution,
        background=_background(request, sensor.at_resolution(*resolution)),
        noise_seed=request.noise_seed,
    )
    output.mkdir(parents=True, exist_ok=True)
    for index, image in enumerate(touches.rgb):
        Image.fromarray(image).save(output / f"{index:04d}.png")
    np.save(output / "depth.npy", touches.depth_m)
    labels = {name: getattr(touches, name).tolist() for name in LABELS}
    # JSON has no NaN: a rigid contact has no force.
    labels["force_n"] = [None if np.isnan(force) else force for force in labels["force_n"]]
    (output / "labels.json").write_text(json.dumps(labels, indent=1))
    return PressSummary(folder=str(output), touches=len(touches), reachable=int(touches.reachable.sum()))


def _read_numbers(
    path: Path, columns: tuple[int, ...], dimensions: tuple[int, ...] = (2,), remedy: str = ""
) -> np.ndarray:
    """Read finite numbers as float64, with one of these lengths of the last axis and numbers of axes."""
    try:
        require_regular(path)
        values = np.asarray(np.load(path, allow_pickle=False), dtype=np.float64)
    except (ValueError, TypeError) as error:
        finding = f"not an .npy file of numbers ({error})"
        raise InputError(str(path), finding, "Write it with numpy.save.") from error
    remedy = remedy or f"Give an (n, {columns[0]}) array of numbers."
    if values.ndim not in dimensions or values.shape[-1] not in columns:
        raise InputError(str(path), f"shape {values.shape}", remedy)
    if not np.isfinite(values).all():
        raise InputError(str(path), "holds values that are not finite", "Give numbers.")
    return values


def _contacts(
    file: ObjectFile, count_or_path: int | Path, seed: int, *, reachable: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return contacts (n, 3), drawn or read, and the outward unit normals there."""
    if isinstance(count_or_path, int):
        return file.sample_contacts(count_or_path, seed, reachable=reachable)
    points = _read_numbers(count_or_path, (3,))
    closest = file.project(points)
    return points, file.surface.normals_at(closest.face, closest.barycentric)


def _pushes(normals: np.ndarray, path: Path | None) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return impulses (n, 3), 1 N s inwards without a file, or forces (n, k, 3); the other is None."""
    values = -normals if path is None else _read_numbers(path, (3,), (2, 3))
    return (values, None) if values.ndim == 2 else (None, values)


def _in_object_frame(positions: np.ndarray, request: Rendering, file: ObjectFile) -> np.ndarray:
    return positions if request.frame == "object" else file.frame.to_object(positions)


def _lights(request: Rendering, file: ObjectFile) -> Lamps | Environment | None:
    """Return the lamps or the environment of all views; None where the views have lamps of their own."""
    if request.light and request.environment is not None:
        raise InputError("--light", "beside --environment", "Give one of them.")
    if request.environment is not None:
        return Environment.of(_environment(request.environment))
    if not request.light:
        return None
    lights = np.array(request.light, dtype=np.float64).reshape(-1, 6)
    if not np.isfinite(lights).all():
        raise InputError("--light", f"{request.light} is not finite", "Give X Y Z R G B as numbers.")
    return Lamps(_in_object_frame(lights[:, :3], request, file)[None], lights[:, 3:])


def _environment(path: Path) -> np.ndarray:
    """Read an OpenEXR or Radiance map as (h, w, 3) float64 linear radiance, row 0 on top."""
    # OpenCV reads OpenEXR only with this variable, by which a user states that files are trusted.
    os.environ.setdefault("OPENCV_IO_ENABLE_OPENEXR", "1")
    import cv2

    content = np.frombuffer(read_regular(path), np.uint8)
    image: Any = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if content.size else None
    if image is None or image.ndim != 3 or image.dtype.kind != "f":
        raise InputError(str(path), "not a map of linear radiance", "Give an OpenEXR or Radiance HDR file.")
    return np.asarray(image[..., 2::-1], dtype=np.float64)


def _background(request: Pressing, sensor: Any) -> np.ndarray | None:
    """Return the image (height, width, 3) to lay touches over, at the resolution of the sensor."""
    if not request.background:
        return None
    if request.background == "synthetic":
        return synthetic_background(sensor, request.noise_seed or 0)
    try:
        with open_regular(request.background) as file, Image.open(file) as image:
            size = (sensor.image_width, sensor.image_height)
            return np.asarray(image.convert("RGB").resize(size, Image.Resampling.BILINEAR))
    except OSError as error:
        finding = f"not an image ({error})"
        raise InputError(request.background, finding, "Give a picture for --background.") from error
