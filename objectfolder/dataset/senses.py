"""What samples of a sense are: their queries, the truth of them, and what an Object File answers.

Samples of one object come together: arrays with a row a sample. Truth and answer have the same keys, shapes
and units, so that one can stand for the other.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from objectfolder.audio.synthesis.bank import mode_bank, samples_of
from objectfolder.dataset.reading import ProductReader
from objectfolder.object_file.object_file import ObjectFile
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
    sub_rays
        Of views of Object Files.
    passes
        Whether views come with depth and mask.
    """

    duration_s: float = 1.0
    sample_rate_hz: float = 44100.0
    resolution: int = 128
    sub_rays: int | None = None
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
        The samples of rows.
    answer
        The samples of an Object File for queries.
    """

    kind: str
    queries: Callable[[ProductReader, np.ndarray], Sample]
    sampled: Callable[[ObjectFile, int, int], Sample]
    truth: Callable[[ProductReader, np.ndarray, Sample, Settings], Sample]
    answer: Callable[[ObjectFile, Sample, Settings, ProductReader | None], Sample]


def _pictures(rgb: np.ndarray) -> np.ndarray:
    """Return (n, h, w, 3) uint8 as (n, 3, h, w) float32 from 0 to 1."""
    return np.ascontiguousarray(rgb.transpose(0, 3, 1, 2), dtype=np.float32) / np.float32(255)


def _views(reader: ProductReader, rows: np.ndarray) -> Sample:
    frame = UnitFrame.from_dict(reader.attributes["frame"])
    return {
        "camera_to_object": frame.camera_to_object(reader.whole("camera_to_world")[rows]),
        "light_position_m": frame.to_object(reader.whole("light_position")[rows]),
    }


def _sampled_views(file: ObjectFile, count: int, seed: int) -> Sample:
    cameras, lights = file.sample_views(count, seed)
    return {"camera_to_object": cameras, "light_position_m": lights}


def _true_views(reader: ProductReader, rows: np.ndarray, query: Sample, settings: Settings) -> Sample:
    samples = {"image": _pictures(on_white(reader.rows("rgba", rows)))}
    if settings.passes:
        scale = np.float32(reader.attributes["frame"]["scale"])
        samples |= {"depth_m": reader.rows("depth", rows) * scale, "mask": reader.rows("mask", rows)}
    return samples


def _rendered_views(
    file: ObjectFile, query: Sample, settings: Settings, reader: ProductReader | None
) -> Sample:
    size: int | tuple[int, int] = settings.resolution
    field_of_view = FIELD_OF_VIEW_DEG
    if reader is not None:
        height, width = reader.shape("rgba")[1:3]
        size, field_of_view = (height, width), float(reader.attributes["field_of_view_deg"])
    passes = ("image", "depth", "mask") if settings.passes else ("image",)
    rendering = file.render_passes(
        query["camera_to_object"],
        passes,
        query["light_position_m"],
        size,
        field_of_view_deg=field_of_view,
        sub_rays=settings.sub_rays,
    )
    samples = {"image": _pictures(rendering["image"])}
    if settings.passes:
        samples |= {"depth_m": rendering["depth"], "mask": rendering["mask"]}
    return samples


def _strikes(reader: ProductReader, rows: np.ndarray) -> Sample:
    # As fidelity is measured: 1 N s along x, y and z in turn.
    return {"point_m": reader.whole("points")[rows], "impulse_n_s": np.eye(3)[np.arange(len(rows)) % 3]}


def _sampled_strikes(file: ObjectFile, count: int, seed: int) -> Sample:
    points, normals = file.sample_contacts(count, seed, reachable=False)
    return {"point_m": points, "impulse_n_s": -normals}


def _true_sounds(reader: ProductReader, rows: np.ndarray, query: Sample, settings: Settings) -> Sample:
    # Sums of its own for every row: its bits do not depend on the others.
    shapes = reader.rows("mode_shapes", rows)
    struck, moved = (
        (directions[:, :, None] * shapes).sum(axis=1)
        for directions in (query["impulse_n_s"], reader.rows("normals", rows))
    )
    sounds = mode_bank(
        reader.whole("eigenvalues"),
        reader.whole("dampings_per_s"),
        struck * moved,
        duration_s=settings.duration_s,
        sample_rate_hz=settings.sample_rate_hz,
        out=np.empty((len(rows), samples_of(settings.duration_s, settings.sample_rate_hz)), np.float32),
    )
    return {"sound": sounds}


def _struck_sounds(
    file: ObjectFile, query: Sample, settings: Settings, reader: ProductReader | None
) -> Sample:
    point, impulse = query["point_m"], query["impulse_n_s"]
    return {"sound": file.strike(point, impulse, settings.duration_s, settings.sample_rate_hz)}


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


def _true_touches(reader: ProductReader, rows: np.ndarray, query: Sample, settings: Settings) -> Sample:
    return {
        "image": _pictures(reader.rows("rgb", rows)),
        "depth_m": reader.rows("depth", rows),
        "mask": reader.rows("mask", rows),
        "sensor_to_object": reader.rows("sensor_to_object", rows),
        "reachable": reader.rows("reachable", rows),
    }


def _pressed_touches(
    file: ObjectFile, query: Sample, settings: Settings, reader: ProductReader | None
) -> Sample:
    touches = file.press(query["point_m"], query["press_depth_m"], query["tilt_deg"], query["azimuth_deg"])
    return {
        "image": _pictures(touches.rgb),
        "depth_m": touches.depth_m,
        "mask": touches.mask,
        "sensor_to_object": touches.sensor_to_object,
        "reachable": touches.reachable,
    }


SENSE_READERS = {
    "vision": Sense("views", _views, _sampled_views, _true_views, _rendered_views),
    "audio": Sense("modes", _strikes, _sampled_strikes, _true_sounds, _struck_sounds),
    "touch": Sense("touches", _touches, _sampled_touches, _true_touches, _pressed_touches),
}
