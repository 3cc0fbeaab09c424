"""A scene of objects as a video with its sound."""

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.synthesis.wav import listening_gain
from objectfolder.errors import QueryError
from objectfolder.extras import needs_extra
from objectfolder.live.sight import LiveSight
from objectfolder.live.sound import LiveSound
from objectfolder.products.atomic import atomic_write

FRAMES_PER_S, AUDIO_RATE_HZ = 30, 44100
AAC_SAMPLES = 1024  # of a frame of its own
# Of x264: a constant rate factor at which one sees no loss. Its macroblock tree differs from run to run.
SETTINGS = {"crf": "18", "x264-params": "mbtree=0"}


def recorded(
    sound: LiveSound, sight: LiveSight, camera_to_world: NDArray[np.float64], seconds: float,
    resolution: tuple[int, int],
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.float64]]]:  # fmt: skip
    """Run a simulation, and yield each frame's image (h, w, 3) and its sound (samples,) in pascals.

    The sound's blocks must last as long as a frame: `AUDIO_RATE_HZ / FRAMES_PER_S` samples.
    """
    for _ in range(round(seconds * FRAMES_PER_S)):
        image = sight.image(camera_to_world, resolution).rgb
        yield image, sound.block()


def beside(image: NDArray[np.uint8], pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return an image (h, w, 3) with pictures one above the other at its right.

    Raises
    ------
    QueryError
        The pictures are not as high as the image together.
    """
    column = np.concatenate(pictures)
    if len(column) != len(image):
        finding = f"{len(image)} rows beside pictures of {len(column)}"
        raise QueryError("pictures", finding, "Let both be as high.")
    return np.concatenate([image, column], axis=1)


def write_clip(
    path: Path, parts: Iterable[tuple[NDArray[np.uint8], NDArray[np.float64]]], resolution: tuple[int, int]
) -> float:
    """Write H.264 and AAC as MP4, and return the largest pressure, pascals.

    The sound is times `listening_gain` of that pressure.

    Parameters
    ----------
    parts
        Images (h, w, 3) sRGB, `FRAMES_PER_S` of them a second, and the pressure (samples,) in pascals at
        `AUDIO_RATE_HZ` meanwhile, as of `recorded`. One image at a time is in memory.
    resolution
        Height and width, even numbers.

    Raises
    ------
    MissingPackageError
        PyAV is not installed.
    QueryError
        An odd side.
    """
    with needs_extra("video"):
        import av
    height, width = resolution
    if height % 2 or width % 2:
        raise QueryError("resolution", f"{height} x {width} pixels", "Videos have even sides.")
    with atomic_write(path) as file, av.open(file, "w", format="mp4") as container:
        video = container.add_stream("libx264", rate=FRAMES_PER_S, options=SETTINGS)
        video.codec_context.thread_count = 1  # the same frames give the same bytes
        video.width, video.height, video.pix_fmt = width, height, "yuv420p"
        audio = container.add_stream("aac", rate=AUDIO_RATE_HZ, layout="mono")
        heard = [np.zeros(0)]
        for image, pressure in parts:
            _mux(container, video, av.VideoFrame.from_ndarray(image, format="rgb24"))
            heard.append(pressure)
        sound = np.concatenate(heard)
        peak_pa = float(abs(sound).max(initial=0.0))
        for start in range(0, len(sound), AAC_SAMPLES):
            part = (listening_gain(peak_pa) * sound[None, start : start + AAC_SAMPLES]).astype(np.float32)
            frame = av.AudioFrame.from_ndarray(part, format="fltp", layout="mono")
            frame.sample_rate, frame.pts, frame.time_base = AUDIO_RATE_HZ, start, Fraction(1, AUDIO_RATE_HZ)
            _mux(container, audio, frame)
        for stream in (video, audio):
            _mux(container, stream, None)
    return peak_pa


def _mux(container: Any, stream: Any, frame: Any) -> None:
    for packet in stream.encode(frame):
        container.mux(packet)
