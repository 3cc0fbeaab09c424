"""Everything measured of one Object File against its ground truth, on held-out queries."""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from objectfolder.audio.synthesis.struck_body import RMS
from objectfolder.fidelity import feel, sight, sound
from objectfolder.fidelity.conditions import CONDITION_DEFINITIONS, measure_conditions
from objectfolder.fidelity.contacts import contact_pictures
from objectfolder.fidelity.sheets import sheet, webp
from objectfolder.fidelity.sounds import stft_distance
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.store import Array, Product
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.touch.presses.touches import Press
from objectfolder.touch.touchnet import TouchNet

PICTURES = 4
TURNTABLE_FRAMES, TURNTABLE_PIXELS, TURNTABLE_SUB_RAYS = 8, 220, 4
SUB_RAY_COUNTS = (4, 16, 64)
MODE_SHARES = (0.25, 0.5, 1.0)
SURFACE_STEPS_M = (64e-6, 8e-6, 1e-6)


@dataclass(frozen=True)
class Verification:
    """What was measured of one Object File.

    Parameters
    ----------
    measures
        Attributes ``object``, ``body``, ``vision``, ``audio``, ``touch``, ``bytes``, ``speed_error``,
        ``definitions``; arrays of a few held-out pairs to look at and listen to.
    file
        The Object File with its fidelity in its description.
    query_seconds
        CPU seconds a query at each setting of ``speed_error``, by its ``key``; of this machine and this
        moment, and so no part of the measures.
    """

    measures: Product
    file: ObjectFile
    query_seconds: dict[str, float]


def verify_object(file: ObjectFile, views: Product, modes: Product, touches: Product) -> Verification:
    """Measure a file's fidelity on the held-out part of its ground truth.

    Examples
    --------
    >>> import objectfolder
    >>> from objectfolder.products import read_product
    >>> from objectfolder.making import simulate_touches
    >>> from objectfolder.touch import Sensor
    >>> bar = objectfolder.load("bar.safetensors")
    >>> views, modes = read_product("views.zarr.zip"), read_product("modes.zarr.zip")
    >>> touches = simulate_touches(bar.surface, Sensor(), touches=0, held_out_touches=2, seed=0)
    >>> measures = verify_object(bar, views, modes, touches).measures.attributes
    >>> measures["audio"]["frequency_error_cents"], measures["touch"]["held_out_touches"]
    (0.0, 2)
    """
    seconds: dict[str, float] = {}
    sight_summary, sight_rows, sight_arrays = _sight(file, views, seconds)
    sound_summary, sound_rows, sound_arrays = _sound(file, modes, seconds)
    feel_summary, feel_rows, feel_arrays = _feel(file, touches, seconds)
    summary = {
        "vision": _scalars(sight_summary),
        "audio": _scalars(sound_summary),
        "touch": _scalars(feel_summary),
    }
    verified = file.with_description(fidelity=summary)
    parts = verified.bytes_by_part()
    metadata = sum(len(value) for value in verified.content().metadata.values())
    attributes = {
        "object": {**file.description["object"], "material": file.description["material"]["name"]},
        "body": file.description["body"],
        "vision": sight_summary,
        "audio": sound_summary,
        "touch": feel_summary,
        "bytes": {"total": sum(parts.values()) + metadata, **parts, "metadata": metadata},
        "speed_error": [*sight_rows, *sound_rows, *feel_rows],
        "definitions": {
            **sight.SIGHT_DEFINITIONS,
            **(CONDITION_DEFINITIONS if views.attributes.get("conditions") else {}),
            **sound.SOUND_DEFINITIONS,
            **feel.definitions(touches),
        },
    }
    measures = Product({**sight_arrays, **sound_arrays, **feel_arrays}, attributes)
    return Verification(measures, verified, seconds)


def _scalars(summary: dict[str, Any]) -> dict[str, Any]:
    """What of a summary travels in the Object File: no tables."""
    return {key: value for key, value in summary.items() if not isinstance(value, list | dict)}


@contextlib.contextmanager
def _timed(seconds: dict[str, float], key: str, queries: int) -> Iterator[None]:
    """Note the CPU seconds a query of what is done inside."""
    begin = time.process_time()
    yield
    seconds[key] = (time.process_time() - begin) / max(queries, 1)


def _key(sense: str, setting: str, value: float) -> str:
    return f"{sense}.{setting}={value:g}"


def _row(sense: str, setting: str, value: float, error: float | None, unit: str, size: int) -> dict[str, Any]:
    return {
        "sense": sense,
        "setting": setting,
        "value": value,
        "error": error,
        "error_unit": unit,
        "bytes": size,
        "key": _key(sense, setting, value),
    }


def _spread(order: np.ndarray) -> np.ndarray:
    """Return at most `PICTURES` of indices in an order, evenly with both ends."""
    return order[np.unique(np.linspace(0, len(order) - 1, PICTURES).round().astype(int))]


def _file(content: np.ndarray, name: str) -> Array:
    return Array(content, ("byte",), "1", f"WebP file: {name}", chunk_first=False)


def _sight(
    file: ObjectFile, views: Product, seconds: dict[str, float]
) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, Array]]:
    truth, foreground = sight.held_out_truth(views)
    file.render(*file.sample_views(1, seed=0), resolution=8)  # builds the network and the ray tracer
    answers = {}
    for sub_rays in sorted({*SUB_RAY_COUNTS, file.vision.sub_rays}):
        with _timed(seconds, _key("vision", "sub_rays", sub_rays), len(truth)):
            answers[sub_rays] = sight.held_out_answer(file, views, sub_rays)
    answer = answers[file.vision.sub_rays]
    filled = sight.trivial_answer(views)
    trivial = sight.measure_sight(truth, foreground, filled)
    measured = sight.measure_sight(truth, foreground, answer)
    lit = sight.lit_pixels(views)
    of_lit = sight.measure_within(truth, lit, answer, sight.LEAST_LIT_PIXELS)
    measured["psnr_foreground_worst_db"] = min(sight.measure_within(truth, foreground, answer), default=None)
    if of_lit:
        of_trivial = sight.measure_within(truth, lit, filled, sight.LEAST_LIT_PIXELS)
        measured |= {
            "psnr_lit_db": float(np.mean(of_lit)),
            "psnr_lit_worst_db": min(of_lit),
            "trivial_psnr_lit_db": float(np.mean(of_trivial)),
        }
    parts = file.bytes_by_part()
    rows = []
    for sub_rays, images in answers.items():
        psnr = float(np.mean(sight.measure_within(truth, np.ones_like(foreground), images)))
        rows.append(_row("vision", "sub_rays", sub_rays, psnr, "PSNR dB", parts["vision"] + parts["surface"]))
    shown = _spread(np.argsort([row["psnr_db"] for row in measured["per_view"]], kind="stable"))
    summary = {
        **measured,
        **sight.measure_reflectance(file, views),
        **sight.measure_glass(file, views),
        **measure_conditions(file, views),
        "noise_floor_db": views.attributes["noise_floor_db"],
        "trivial_psnr_db": trivial["psnr_db"],
        "trivial_psnr_foreground_db": trivial["psnr_foreground_db"],
        "trivial_ssim": trivial["ssim"],
        "held_out_views": len(truth),
        # The source's material is all there is where nothing is learned.
        "training_views": 0 if file.vision.computed else int((~views["held_out"]).sum()),
        "resolution": int(truth.shape[1]),
        "sub_rays": file.vision.sub_rays,
    }
    turning = file.pictures(TURNTABLE_FRAMES, TURNTABLE_PIXELS, sub_rays=TURNTABLE_SUB_RAYS)
    dims = ("picture", "y", "x", "channel")
    arrays = {
        "vision_truth": Array(truth[shown], dims, "1", "held-out views on white, worst first: truth"),
        "vision_answer": Array(answer[shown], dims, "1", "held-out views on white, worst first: Object File"),
        "vision_sheet": _file(sheet(truth, answer), "every held-out view"),
        "turntable": _file(
            webp(np.concatenate(list(turning), axis=1)), "from all round, in a studio's light"
        ),
    }
    return summary, rows, arrays


def _sound(
    file: ObjectFile, modes: Product, seconds: dict[str, float]
) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, Array]]:
    summary = sound.measure_sound(file, modes)
    count = len(file.modes.frequencies_hz)
    rows = []
    if count:
        truth = sound.true_sounds(modes)
        points, impulses = sound.struck(modes)
        for share in MODE_SHARES:
            mode_count = max(1, round(share * count))
            with _timed(seconds, _key("audio", "modes", mode_count), len(points)):
                partial = file.strike(
                    points, impulses, sound.DURATION_S, sound.SAMPLE_RATE_HZ, modes=mode_count, observed=RMS
                )
            error = 10 * np.log10(max(stft_distance(truth, partial, sound.SAMPLE_RATE_HZ), 1e-30))
            size = round(file.bytes_by_part()["audio"] * mode_count / count)
            rows.append(_row("audio", "modes", mode_count, float(error), "STFT distance dB", size))
    return summary, rows, sound.strike_arrays(file, modes) if count else {}


def _feel(
    file: ObjectFile, touches: Product, seconds: dict[str, float]
) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, Array]]:
    held_out = touches["held_out"]
    truth, mask = touches["rgb"][held_out], touches["mask"][held_out]
    queries = (touches["points"][held_out], touches["depth_m"][held_out])
    angles = (touches["tilt_deg"][held_out], touches["azimuth_deg"][held_out])
    answer = file.press(*queries, *angles)
    measured = feel.measure_feel(truth, mask, answer.rgb, answer.mask)
    per_touch = feel.measure_touches(truth, mask, answer.rgb, answer.mask)
    blank = np.broadcast_to(file.touch.no_contact, truth.shape)
    empty = feel.measure_feel(truth, mask, blank, np.zeros_like(mask))
    rows = []
    for step in SURFACE_STEPS_M:
        tensors = encode_surface(file.surface, step)
        net = TouchNet(decode_surface(tensors), file.touch.sensor, contact=file.touch.net.contact)
        net.press(queries[0][:1])  # prepares the surface
        with _timed(seconds, _key("touch", "surface_step_um", step * 1e6), len(truth)):
            coarse = net.press(queries[0], Press(queries[1], None, *angles))
        contact = feel.in_contact(feel.measure_touches(truth, mask, coarse.rgb, coarse.mask))
        error = float(np.mean(contact)) if contact else None
        size = sum(tensor.nbytes for tensor in tensors.values())
        rows.append(_row("touch", "surface_step_um", step * 1e6, error, "contact PSNR dB", size))
    # Those that touch nothing come last.
    psnr = np.array([row["psnr_contact_db"] for row in per_touch], dtype=np.float64)
    order = np.argsort(psnr, kind="stable")
    shown = _spread(order[: np.isfinite(psnr).sum() or len(order)])
    summary = {
        **measured,
        "per_touch": per_touch,
        "empty_psnr_db": empty["psnr_db"],
        "empty_psnr_contact_db": empty["psnr_contact_db"],
        "empty_ssim": empty["ssim"],
        "training_touches": 0,  # the surface and the sensor are all there is
        "held_out_touches": int(held_out.sum()),
        **feel.measure_reach(touches),
        **feel.measure_renderers(touches),
        "surface_bytes": file.bytes_by_part()["surface"],
    }
    dims = ("picture", "y", "x", "channel")
    arrays = {
        "touch_truth": Array(truth[shown], dims, "1", "held-out touches with a contact, worst first: truth"),
        "touch_answer": Array(answer.rgb[shown], dims, "1", "the same touches: Object File"),
        "touch_sheet": _file(sheet(truth, answer.rgb), "every held-out touch"),
        **_contacts(file, touches),
    }
    return summary, rows, arrays


def _contacts(file: ObjectFile, touches: Product) -> dict[str, Array]:
    shown = contact_pictures(file.surface, touches, touches["held_out"])
    sides = shown.sides.reshape(-1, *shown.sides.shape[2:])
    return {
        "touch_sides": _file(webp(sides), "the object from sides where held-out touches were made"),
        "touch_side": Array(shown.side, ("touch",), "1", "which side shows a touch", chunk_first=False),
        "touch_visible": Array(shown.visible, ("touch",), "1", "whether it is in sight", chunk_first=False),
        "touch_pixels": Array(
            shown.pixels,
            ("touch", "place", "axis"),
            "pixel",
            "contact point, begin of the arrow to it, and corners of the gel there",
            chunk_first=False,
        ),
    }
