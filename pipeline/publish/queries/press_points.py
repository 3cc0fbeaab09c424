"""Touches of an Object File, written as images, depth maps and labels."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

import objectfolder
from objectfolder.errors import InputError
from objectfolder.touch.calibrated import synthetic_background
from pipeline.publish.queries.query_files import made_folder, read_numbers
from pipeline.publish.queries.requests import Pressing

LABELS = ("reachable", "penetration_m", "first_contact_offset_m", "contact_area_m2", "force_n", "saturated",
          "sensor_to_object")  # fmt: skip


def press_points(
    path: Path, wanted: Pressing, output: Path, depth_m: float | None = None, force_n: float | None = None
) -> str:
    """Press the sensor at a file of points; return what was done, in a line.

    Parameters
    ----------
    path
        The Object File.
    wanted
        Points and options.
    output
        Folder for the touches.
    depth_m
        Metres into the gel.
    force_n
        Or newtons along the sensor's axis; the gel is elastic then.

    Raises
    ------
    InputError
        A file or an option that cannot be used.
    QueryError
        What the Object File cannot answer.
    """
    file = objectfolder.load(path)
    sensor = file.touch.sensor
    resolution = wanted.resolution or (sensor.image_height, sensor.image_width)
    background = None
    if wanted.background == "synthetic":
        background = synthetic_background(sensor.at_resolution(*resolution), wanted.noise_seed or 0)
    elif wanted.background:
        background = _background(wanted.background, resolution)
    touches = file.press(
        read_numbers(wanted.points, (3,)),
        depth_m,
        wanted.tilt_deg,
        wanted.azimuth_deg,
        force=force_n,
        contact=wanted.contact,
        resolution=resolution,
        background=background,
        noise_seed=wanted.noise_seed,
    )
    folder = made_folder(output)
    for index, image in enumerate(touches.rgb):
        Image.fromarray(image).save(folder / f"{index:04d}.png")
    np.save(folder / "depth.npy", touches.depth)
    labels = {name: getattr(touches, name).tolist() for name in LABELS}
    # JSON has no NaN: a rigid contact has no force.
    labels["force_n"] = [None if np.isnan(force) else force for force in labels["force_n"]]
    (folder / "labels.json").write_text(json.dumps(labels, indent=1))
    return f"{folder}: {len(touches.rgb)} touches, {int(touches.reachable.sum())} reachable"


def _background(path: str, resolution: tuple[int, int]) -> np.ndarray:
    """Read an image (height, width, 3) of any size at a resolution (height, width)."""
    try:
        with Image.open(path) as image:
            resized = image.convert("RGB").resize(resolution[::-1], Image.Resampling.BILINEAR)
    except OSError as error:
        raise InputError(path, f"not an image ({error})", "Give a picture for --background.") from error
    return np.asarray(resized)
