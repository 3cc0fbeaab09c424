"""The pictures of README and docs/results.md, drawn from a finished data set.

Run as ``python -m bench pictures [--data FOLDER] [--strike ID]``; writes into docs/. ``hero.png`` is
what Object Files answer, ``live_sight.png`` the scene of ``objectfolder demo``, ``demo.webp`` its objects as
they fall. ``sight.png``, ``touch.png`` and ``sound.png`` are held-out queries beside the truth: views are the
best lit of each object, touches those with the largest contact.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import av
import matplotlib
import mujoco
import numpy as np

from bench.record import REPOSITORY, arguments
from objectfolder.fidelity.sound import SAMPLE_RATE_HZ, stored_strike
from objectfolder.live import MujocoSimulation
from objectfolder.live.clip import FRAMES_PER_S
from objectfolder.products.store import Product, read_product
from pipeline.publish.demo import write_demo
from pipeline.publish.scenes.opened_scene import OpenedScene, camera_over
from pipeline.publish.scenes.playing import play

matplotlib.use("Agg")
from matplotlib import pyplot

WINDOW, HOP = 2048, 128
RANGE_DB = 80.0
SHOWN_S = 0.5
TOUCHED = 4
GREY, DIFFERENCE_FACTOR = 128, 8
# Of the animated picture: seconds, height, pixels down and across, and of how many frames one is kept.
FALL_S, FALL_M, FALL_PIXELS, FALL_EVERY = 3.0, 0.06, (360, 540), 2


def draw_hero(path: Path, products: dict[str, Product], name: str) -> None:
    """Draw objects that are seen on a table, one that is struck, and one that is felt."""
    figure, axes = pyplot.subplots(
        1, 3, figsize=(15, 4.6), width_ratios=(1.75, 1.2, 0.8), layout="constrained"
    )
    axes[0].imshow(table((700, 1000)))
    axes[0].set_title("Seen: four Object Files on a table")
    level = _level(_frames(stored_strike(products[name], 1, 0)))
    image = axes[1].imshow(
        level.T, origin="lower", aspect="auto", cmap="magma", vmin=-RANGE_DB, vmax=0,
        extent=(0, SHOWN_S, 0, SAMPLE_RATE_HZ / 2000),
    )  # fmt: skip
    axes[1].set(title=f"Heard: the {name}, struck", xlabel="time, s", ylabel="frequency, kHz", ylim=(0, 20))
    figure.colorbar(image, ax=axes[1], label="level, dB")
    touches = products[name]["touch_answer"]
    axes[2].imshow(touches[touches.reshape(len(touches), -1).std(axis=1).argmax()])
    axes[2].set_title(f"Felt: the {name}, by a DIGIT")
    for axis in (axes[0], axes[2]):
        axis.set(frame_on=False, xticks=[], yticks=[])
    figure.savefig(path, dpi=90)
    pyplot.close(figure)


def table(size: tuple[int, int]) -> np.ndarray:
    """The scene of ``objectfolder demo`` as it begins, (height, width, 3) uint8."""
    with TemporaryDirectory() as folder:
        opened = OpenedScene.of(write_demo(Path(folder)))
        simulation = MujocoSimulation(opened.model, mujoco.MjData(opened.model))
        camera = camera_over(opened.points(simulation))
        image = opened.sight(simulation).image(camera, size, sub_rays=16)
    rgb: np.ndarray = image.rgb
    return rgb


def draw_fall(path: Path) -> None:
    """Draw the objects of ``objectfolder demo`` as they fall on their table, as an animated WebP."""
    with TemporaryDirectory() as folder:
        clip = Path(folder) / "clip.mp4"
        play(write_demo(Path(folder)), clip, FALL_S, FALL_M, FALL_PIXELS, seed=1)
        with av.open(str(clip)) as video:
            frames = [frame.to_image() for frame in video.decode(video=0)][::FALL_EVERY]
    pause_ms = round(1000 * FALL_EVERY / FRAMES_PER_S)
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=pause_ms, loop=0, quality=70, method=6
    )


def best_lit(fidelity: Product) -> int:
    """Which of the kept views is brightest where it is not white."""
    truth = fidelity["vision_truth"].astype(np.float64).mean(axis=3)
    return int(np.argmax([view[view < 255].mean() for view in truth]))


def sight(products: list[Product]) -> np.ndarray:
    """Truth above, Object File below, a column an object, uint8."""
    columns = []
    for product in products:
        view = best_lit(product)
        columns.append(np.concatenate([product["vision_truth"][view], product["vision_answer"][view]]))
    return np.concatenate(columns, axis=1)


def touch(products: list[Product]) -> np.ndarray:
    """Truth, Object File and difference of the largest contact of the objects with the largest, uint8."""
    contacts = []
    for product in products:
        truth = product["touch_truth"].astype(np.float64)
        spread = truth.reshape(len(truth), -1).std(axis=1)
        index = int(spread.argmax())
        contacts.append((-spread[index], product["touch_truth"][index], product["touch_answer"][index]))
    contacts.sort(key=lambda item: item[0])
    rows = [np.concatenate([t, a, difference_picture(t, a)], axis=1) for _, t, a in contacts[:TOUCHED]]
    return np.concatenate(rows, axis=1)


def difference_picture(truth: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """Return grey plus `DIFFERENCE_FACTOR` times (answer - truth), clipped to uint8."""
    difference = answer.astype(np.int32) - truth
    return np.clip(GREY + DIFFERENCE_FACTOR * difference, 0, 255).astype(np.uint8)


def draw_strike(path: Path, fidelity: Product, name: str) -> None:
    """Spectrograms and spectra of the first held-out strike."""
    sounds = [stored_strike(fidelity, which, 0) for which in (0, 1)]
    figure, axes = pyplot.subplots(1, 3, figsize=(12, 3.2), width_ratios=(1, 1, 1.2), layout="constrained")
    top = max(np.abs(_frames(sound)).max() for sound in sounds)
    for axis, sound, title in zip(axes, sounds, ("truth", "Object File"), strict=False):
        level = _level(_frames(sound), top)
        image = axis.imshow(
            level.T, origin="lower", aspect="auto", cmap="magma", vmin=-RANGE_DB, vmax=0,
            extent=(0, SHOWN_S, 0, SAMPLE_RATE_HZ / 2000),
        )  # fmt: skip
        axis.set(title=f"{name}, {title}", xlabel="s", ylabel="kHz", ylim=(0, 20))
    figure.colorbar(image, ax=axes[:2], label="dB")
    taper = np.hanning(2 * len(sounds[0]))[len(sounds[0]) :]
    frequency = np.fft.rfftfreq(len(taper), 1 / SAMPLE_RATE_HZ) / 1000
    spectra = [np.abs(np.fft.rfft(sound * taper)) for sound in (*sounds, sounds[1] - sounds[0])]
    for spectrum, label in zip(spectra, ("truth", "Object File", "difference"), strict=True):
        level = 20 * np.log10(np.maximum(spectrum / spectra[0].max(), 1e-9))
        axes[2].plot(frequency, level, linewidth=0.7, label=label)
    axes[2].set(title="spectrum of one second", xlabel="kHz", ylabel="dB", xlim=(0, 20), ylim=(-120, 3))
    axes[2].legend(fontsize="small", loc="lower left")
    figure.savefig(path, dpi=80)
    pyplot.close(figure)


def _frames(sound: np.ndarray) -> np.ndarray:
    """Spectra (frames, bins) of Hann windows over the part shown."""
    cut = sound[: int(SHOWN_S * SAMPLE_RATE_HZ) + WINDOW]
    frames = np.lib.stride_tricks.sliding_window_view(cut, WINDOW)[::HOP]
    return np.fft.rfft(frames * np.hanning(WINDOW), axis=1)


def _level(frames: np.ndarray, top: float | None = None) -> np.ndarray:
    """Return decibels below `top`, which is the highest magnitude by default."""
    return 20 * np.log10(np.maximum(np.abs(frames) / (top or np.abs(frames).max()), 1e-12))


def main() -> None:
    """Draw the pictures."""
    parser = arguments(__doc__)
    parser.add_argument("--data", type=Path, default=REPOSITORY / "data", help="of a finished data set")
    parser.add_argument("--strike", default="mug", help="object whose sound is drawn")
    options = parser.parse_args()
    products = {
        path.name.partition(".")[0]: read_product(path)
        for path in sorted((options.data / "fidelity").glob("*.zarr.zip"))
    }
    folder = REPOSITORY / "docs"
    draw_hero(folder / "hero.png", products, options.strike)
    pyplot.imsave(folder / "live_sight.png", table((360, 480)))
    draw_fall(folder / "demo.webp")
    pyplot.imsave(folder / "sight.png", sight(list(products.values())))
    pyplot.imsave(folder / "touch.png", touch(list(products.values())))
    draw_strike(folder / "sound.png", products[options.strike], options.strike)
