"""What one sample of a sense is: its query, the truth of it, and what an Object File answers.

Truth and answer have the same keys, shapes and units, so that one can stand for the other.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from objectfolder.audio.synthesis import mode_bank
from objectfolder.dataset.reading import ProductReader
from objectfolder.object_file import ObjectFile
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG
from objectfolder.vision.compositing import on_white

Sample = dict[str, np.ndarray]
TOUCH_DEPTH_M = 0.001


@dataclass(frozen=True)
class Settings:
    """What a sample is to be like, beside what its product says.

    Parameters
    ----------
    duration_s, sample_rate_hz
        Of sounds.
    resolution
        Pixels a side of views without a product.
    passes
        Whether views come with depth and mask.
    """

    duration_s: float = 1.0
    sample_rate_hz: float = 44100.0
    resolution: int = 128
    passes: bool = False


@dataclass(frozen=True)
class Sense:
    """How samples of one sense are made.

    Parameters
    ----------
    kind
        Folder of its ground truth.
    queries
        Of the rows of a product, given as indices.
    sampled
        Of an Object File alone: how many are drawn, by a seed.
    truth
        The sample of a row.
    answer
        The sample of an Object File for one query.
    """

    kind: str
    queries: Callable[[ProductReader, np.ndarray], Sample]
    sampled: Callable[[ObjectFile, int, int], Sample]
    truth: Callable[[ProductReader, int, Sample, Settings], Sample]
    answer: Callable[[ObjectFile, Sample, Settings, ProductReader | None], Sample]


def _picture(rgb: np.ndarray) -> np.ndarray:
    """Return (h, w, 3) uint8 as (3, h, w) float32 from 0 to 1."""
    return np.ascontiguousarray(rgb.transpose(2, 0, 1), dtype=np.float32) / np.float32(255)


def _views(reader: ProductReader, rows: np.ndarray) -> Sample:
    frame = UnitFrame.from_dict(reader.attributes["frame"])
    return {
        "camera_to_object": frame.camera_to_object(reader.whole("camera_to_world")[rows]),
        "light_position_m": frame.to_object(reader.whole("light_position")[rows]),
    }


def _sampled_views(file: ObjectFile, count: int, seed: int) -> Sample:
    cameras, lights = file.sample_views(count, seed)
    return {"camera_to_object": cameras, "light_position_m": lights}


def _true_view(reader: ProductReader, row: int, query: Sample, settings: Settings) -> Sample:
    sample = {"image": _picture(on_white(reader.row("rgba", row).astype(np.float32)))}
    if settings.passes:
        scale = np.float32(reader.attributes["frame"]["scale"])
        sample |= {"depth_m": reader.row("depth", row) * scale, "mask": reader.row("mask", row)}
    return sample


def _rendered_view(
    file: ObjectFile, query: Sample, settings: Settings, reader: ProductReader | None
) -> Sample:
    size: int | tuple[int, int] = settings.resolution
    field_of_view = FIELD_OF_VIEW_DEG
    if reader is not None:
        height, width = reader.shape("rgba")[1:3]
        size, field_of_view = (height, width), float(reader.attributes["field_of_view_deg"])
    passes = ("image", "depth", "mask") if settings.passes else ("image",)
    seen = file.render(
        query["camera_to_object"], query["light_position_m"], size, field_of_view, passes=passes
    )
    sample = {"image": _picture(seen["image"][0])}
    if settings.passes:
        sample |= {"depth_m": seen["depth"][0], "mask": seen["mask"][0]}
    return sample


def _strikes(reader: ProductReader, rows: np.ndarray) -> Sample:
    # As fidelity is measured: 1 N s along x, y and z in turn.
    return {"point_m": reader.whole("points")[rows], "impulse_n_s": np.eye(3)[np.arange(len(rows)) % 3]}


def _sampled_strikes(file: ObjectFile, count: int, seed: int) -> Sample:
    points, normals = file.sample_contacts(count, seed)
    return {"point_m": points, "impulse_n_s": -normals}


def _true_sound(reader: ProductReader, row: int, query: Sample, settings: Settings) -> Sample:
    gains = query["impulse_n_s"] @ reader.row("mode_shapes", row).astype(np.float64)
    sound = mode_bank(
        reader.whole("eigenvalues"),
        reader.whole("dampings_per_s"),
        gains[None] * reader.whole("radiation_weights"),
        settings.duration_s,
        settings.sample_rate_hz,
    )
    return {"sound": sound[0].astype(np.float32)}


def _struck_sound(
    file: ObjectFile, query: Sample, settings: Settings, reader: ProductReader | None
) -> Sample:
    point, impulse = query["point_m"], query["impulse_n_s"]
    return {"sound": file.strike(point, impulse, settings.duration_s, settings.sample_rate_hz)[0]}


def _touches(reader: ProductReader, rows: np.ndarray) -> Sample:
    return {
        "point_m": reader.whole("points")[rows],
        "press_depth_m": reader.whole("depth_m")[rows],
        "tilt_deg": reader.whole("tilt_deg")[rows],
        "azimuth_deg": reader.whole("azimuth_deg")[rows],
    }


def _sampled_touches(file: ObjectFile, count: int, seed: int) -> Sample:
    zeros = np.zeros(count)
    points, _ = file.sample_contacts(count, seed)
    return {
        "point_m": points,
        "press_depth_m": zeros + TOUCH_DEPTH_M,
        "tilt_deg": zeros,
        "azimuth_deg": zeros,
    }


def _true_touch(reader: ProductReader, row: int, query: Sample, settings: Settings) -> Sample:
    return {
        "image": _picture(reader.row("rgb", row)),
        "depth_m": reader.row("depth", row),
        "mask": reader.row("mask", row),
        "sensor_to_object": reader.whole("sensor_to_object")[row],
        "reachable": reader.whole("reachable")[row],
    }


def _pressed_touch(
    file: ObjectFile, query: Sample, settings: Settings, reader: ProductReader | None
) -> Sample:
    touch = file.press(
        query["point_m"], float(query["press_depth_m"]), float(query["tilt_deg"]), float(query["azimuth_deg"])
    )
    return {
        "image": _picture(touch.rgb[0]),
        "depth_m": touch.depth[0],
        "mask": touch.mask[0],
        "sensor_to_object": touch.sensor_to_object[0],
        "reachable": touch.reachable[0],
    }


SENSES = {
    "vision": Sense("views", _views, _sampled_views, _true_view, _rendered_view),
    "audio": Sense("modes", _strikes, _sampled_strikes, _true_sound, _struck_sound),
    "touch": Sense("touches", _touches, _sampled_touches, _true_touch, _pressed_touch),
}
