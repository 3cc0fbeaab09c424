"""The command that renders views."""

import argparse
import os
from pathlib import Path
from typing import Any

import numpy as np

import objectfolder
from objectfolder.errors import InputError
from objectfolder.vision.backends import BACKENDS
from objectfolder.vision.environment import RADIUS, environment_lights

PASSES = ("depth", "normal", "mask")


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `render`, but for file and output."""
    command.add_argument(
        "--views",
        required=True,
        metavar="VIEWS.npy",
        help="(n, 6) camera and light positions, unit frame; the lights may be left out, or are not used, "
        "where others are given",
    )
    command.add_argument(
        "--light",
        action="append",
        metavar="X,Y,Z[:R,G,B]",
        help="a light for all views, unit frame, and its linear colour as factors of the data set's light "
        "(default 1,1,1); several times for several lights; --light=-1,0,0 where the first is negative",
    )
    command.add_argument(
        "--environment",
        metavar="FILE.exr|FILE.hdr",
        help="light all views by an equirectangular map of linear radiance, oriented as in Blender",
    )
    command.add_argument(
        "--environment-lights",
        type=int,
        default=64,
        metavar="N",
        help="lights that stand for it (default 64)",
    )
    command.add_argument(
        "--environment-radius",
        type=float,
        default=RADIUS,
        metavar="R",
        help=f"their distance from the centre, unit frame (default {RADIUS:g})",
    )
    command.add_argument("--resolution", type=int, default=256, help="pixels a side (default 256)")
    command.add_argument("--field-of-view", type=float, default=39.6, help="degrees (default 39.6)")
    command.add_argument("--sub-rays", type=int, help="rays in an edge pixel: slower and closer (default 64)")
    command.add_argument(
        "--crop", metavar="TOP,LEFT,HEIGHT,WIDTH", help="render this part of the image alone, pixels"
    )
    command.add_argument(
        "--passes",
        metavar="NAME,NAME",
        help=f"write {', '.join(PASSES)}, too: 0000_depth.npy in metres along the camera's axis, "
        "0000_normal.npy in the object frame, 0000_mask.png",
    )
    command.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="default cpu")
    command.add_argument(
        "--backend",
        choices=BACKENDS,
        help="default: compiled where numba is installed and the device is the CPU",
    )


def render(options: argparse.Namespace, folder: Path) -> None:
    """Render a file of views to PNG."""
    from PIL import Image

    from objectfolder.vision.cameras import look_at

    file = objectfolder.load(options.file).on(options.device, options.backend)
    lights, colours = _lights(options, file.vision.radiance_scale)
    views = _views(options.views, lights is not None)
    passes = _names(options.passes)
    crop = None if options.crop is None else _integers(options.crop)
    for index, view in enumerate(views):
        light = view[None, 3:] if lights is None else lights
        drawn = file.render(
            file.frame.camera_to_object(look_at(view[:3])),
            file.frame.to_object(light)[None],
            options.resolution,
            options.field_of_view,
            sub_rays=options.sub_rays,
            light_colour=colours,
            crop=crop,
            passes=["image", *passes],
        )
        Image.fromarray(drawn["image"][0]).save(folder / f"{index:04d}.png")
        for name in passes:
            values = drawn[name][0]
            if name == "mask":
                Image.fromarray(values.astype(np.uint8) * 255).save(folder / f"{index:04d}_mask.png")
            else:
                np.save(folder / f"{index:04d}_{name}.npy", values)
    shown = "" if lights is None else f", {len(lights)} light{'s' * (len(lights) != 1)}"
    size = f"{options.resolution} pixels" if crop is None else f"{crop[2]} x {crop[3]} pixels"
    more = f" with {', '.join(passes)}" if passes else ""
    print(f"{folder}: {len(views)} images of {size}{more}{shown} ({file.vision.backend})")


def read_environment(path: Path | str) -> np.ndarray:
    """Read an OpenEXR or Radiance map as (h, w, 3) float64 linear radiance, row 0 on top.

    Raises
    ------
    FileNotFoundError
        No such file.
    InputError
        Not a map that OpenCV reads, or no OpenCV.
    """
    if not Path(path).is_file():
        raise FileNotFoundError(2, "no such file", str(path))
    # OpenCV reads OpenEXR only where it is told that its files are trusted.
    os.environ.setdefault("OPENCV_IO_ENABLE_OPENEXR", "1")
    try:
        import cv2
    except ModuleNotFoundError:
        raise InputError(str(path), "no OpenCV to read it", "Install opencv-python-headless.") from None
    image: Any = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 3 or image.dtype.kind != "f":
        raise InputError(str(path), "not a map of linear radiance", "Give an OpenEXR or Radiance HDR file.")
    return np.asarray(image[..., 2::-1], dtype=np.float64)


def _lights(
    options: argparse.Namespace, radiance_scale: float
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the (k, 3) lights, unit frame, and their colours; None for those of the views."""
    if options.light is None and options.environment is None:
        return None, None
    given = [_light(text) for text in options.light or ()]
    positions = [np.array([position for position, _ in given]).reshape(-1, 3)]
    colours = [np.array([colour for _, colour in given]).reshape(-1, 3)]
    if options.environment is not None:
        around = environment_lights(
            read_environment(options.environment),
            options.environment_lights,
            radiance_scale=radiance_scale,
            radius=options.environment_radius,
        )
        positions.append(around[0])
        colours.append(around[1])
    return np.concatenate(positions), np.concatenate(colours)


def _light(text: str) -> tuple[list[float], list[float]]:
    position, _, colour = text.partition(":")
    try:
        values = [[float(number) for number in part.split(",")] for part in (position, colour or "1,1,1")]
    except ValueError:
        values = []
    if [len(part) for part in values] != [3, 3] or not np.isfinite(values).all():
        raise InputError("--light", repr(text), "Give X,Y,Z or X,Y,Z:R,G,B.")
    return values[0], values[1]


def _views(path: str, lit: bool) -> np.ndarray:
    """Read (n, 6) views, or (n, 3) where light comes from elsewhere; pickles are refused."""
    try:
        values = np.load(path, allow_pickle=False)
    except ValueError as error:
        raise InputError(
            path, f"not an .npy file of numbers ({error})", "Write it with numpy.save."
        ) from error
    columns = (3, 6) if lit else (6,)
    if values.ndim != 2 or values.shape[1] not in columns or not np.issubdtype(values.dtype, np.number):
        raise InputError(
            path,
            f"shape {values.shape}",
            "Give an (n, 6) array, or (n, 3) with --light." if not lit else "Give an (n, 6) or (n, 3) array.",
        )
    if not np.isfinite(values).all():
        raise InputError(path, "holds values that are not finite", "Give numbers.")
    return np.asarray(values, dtype=np.float64)


def _names(text: str | None) -> list[str]:
    names = [] if text is None else [name.strip() for name in text.split(",")]
    for name in names:
        if name not in PASSES:
            raise InputError("--passes", repr(name), f"Name some of {', '.join(PASSES)}.")
    return names


def _integers(text: str) -> tuple[int, int, int, int]:
    try:
        top, left, height, width = (int(number) for number in text.split(","))
    except ValueError:
        raise InputError("--crop", repr(text), "Give TOP,LEFT,HEIGHT,WIDTH in pixels.") from None
    return top, left, height, width
