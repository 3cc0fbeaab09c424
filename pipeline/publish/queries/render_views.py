"""Views of an Object File, rendered to PNG."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import objectfolder
from objectfolder.errors import InputError
from objectfolder.vision.cameras import look_at
from objectfolder.vision.environment import RADIUS, environment_lights
from pipeline.publish.queries.query_files import made_folder, read_numbers
from pipeline.publish.queries.requests import Rendering

PASSES = ("depth", "normal", "mask")
Lights = tuple[np.ndarray, np.ndarray]


def render_views(path: Path, wanted: Rendering, output: Path) -> str:
    """Render a file of views into a folder; return what was done, in a line.

    Raises
    ------
    InputError
        A file or an option that cannot be used.
    QueryError
        What the Object File cannot answer.
    """
    file = objectfolder.load(path).on(wanted.device, wanted.backend)
    lights = _lights(wanted, file.vision.radiance_scale)
    views = _views(wanted.views, lights is not None)
    passes = _passes(wanted.passes)
    crop = None if wanted.crop is None else _crop(wanted.crop)
    folder = made_folder(output)
    for index, view in enumerate(views):
        drawn = file.render(
            file.frame.camera_to_object(look_at(view[:3])),
            file.frame.to_object(view[None, 3:] if lights is None else lights[0])[None],
            wanted.resolution,
            wanted.field_of_view_deg,
            sub_rays=wanted.sub_rays,
            light_colour=None if lights is None else lights[1],
            crop=crop,
            passes=["image", *passes],
        )
        _write(folder, index, {name: values[0] for name, values in drawn.items()})
    shown = "" if lights is None else f", {len(lights[0])} light{'s' * (len(lights[0]) != 1)}"
    size = f"{wanted.resolution} pixels" if crop is None else f"{crop[2]} x {crop[3]} pixels"
    more = f" with {', '.join(passes)}" if passes else ""
    return f"{folder}: {len(views)} images of {size}{more}{shown} ({file.vision.backend})"


def read_environment(path: Path) -> np.ndarray:
    """Read an OpenEXR or Radiance map as (h, w, 3) float64 linear radiance, row 0 on top.

    Raises
    ------
    FileNotFoundError
        No such file.
    InputError
        Not a map that OpenCV reads, or no OpenCV.
    """
    if not path.is_file():
        raise FileNotFoundError(2, "no such file", str(path))
    # OpenCV reads OpenEXR only with this variable, by which a user states that files are trusted.
    os.environ.setdefault("OPENCV_IO_ENABLE_OPENEXR", "1")
    try:
        import cv2
    except ModuleNotFoundError:
        raise InputError(str(path), "no OpenCV to read it", "Install opencv-python-headless.") from None
    image: Any = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 3 or image.dtype.kind != "f":
        raise InputError(str(path), "not a map of linear radiance", "Give an OpenEXR or Radiance HDR file.")
    return np.asarray(image[..., 2::-1], dtype=np.float64)


def _write(folder: Path, index: int, drawn: dict[str, np.ndarray]) -> None:
    Image.fromarray(drawn["image"]).save(folder / f"{index:04d}.png")
    for name in set(drawn).intersection(PASSES):
        if name == "mask":
            Image.fromarray(drawn[name].astype(np.uint8) * 255).save(folder / f"{index:04d}_mask.png")
        else:
            np.save(folder / f"{index:04d}_{name}.npy", drawn[name])


def _lights(wanted: Rendering, radiance_scale: float) -> Lights | None:
    """Return the (k, 3) lights, unit frame, and their (k, 3) colours; None for those of the views."""
    if not wanted.light and wanted.environment is None:
        return None
    given = np.array([_light(text) for text in wanted.light]).reshape(-1, 2, 3)
    positions, colours = [given[:, 0]], [given[:, 1]]
    if wanted.environment is not None:
        around = environment_lights(
            read_environment(wanted.environment),
            wanted.environment_lights,
            radiance_scale=radiance_scale,
            radius=RADIUS if wanted.environment_radius is None else wanted.environment_radius,
        )
        positions.append(around[0])
        colours.append(around[1])
    return np.concatenate(positions), np.concatenate(colours)


def _light(text: str) -> list[list[float]]:
    position, _, colour = text.partition(":")
    try:
        values = [[float(number) for number in part.split(",")] for part in (position, colour or "1,1,1")]
    except ValueError:
        values = []
    if [len(part) for part in values] != [3, 3] or not np.isfinite(values).all():
        raise InputError("--light", repr(text), "Give X,Y,Z or X,Y,Z:R,G,B.")
    return values


def _views(path: Path, lit: bool) -> np.ndarray:
    if lit:
        return read_numbers(path, (3, 6), remedy="Give an (n, 6) or (n, 3) array.")
    return read_numbers(path, (6,), remedy="Give an (n, 6) array, or (n, 3) with --light.")


def _passes(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",")] if text else []
    for name in names:
        if name not in PASSES:
            raise InputError("--passes", repr(name), f"Name some of {', '.join(PASSES)}.")
    return names


def _crop(text: str) -> tuple[int, int, int, int]:
    try:
        top, left, height, width = (int(number) for number in text.split(","))
    except ValueError:
        raise InputError("--crop", repr(text), "Give TOP,LEFT,HEIGHT,WIDTH in pixels.") from None
    return top, left, height, width
