"""Rigid touches: against single presses, and how many a second."""

from functools import partial
from typing import Any

import numpy as np

from bench.gpu.run import Run, objects, touches


def touch_equality(run: Run, precision: str, count: int) -> dict[str, Any]:
    """Against `press`, one touch at a time."""
    from objectfolder.batch import Batch

    files = objects()
    batch = Batch(files, run.device, precision=precision)
    which, points, settings = touches(count, files)
    answer = batch.touch.press(which, points, **settings)
    again = batch.touch.press(which, points, **settings)
    alone = batch.touch.press(
        which[3:4], points[3:4], **{name: value[3:4] for name, value in settings.items()}
    )
    # A rigid gel bears no force that is a number, and is not sheared.
    fields = vars(answer)
    fields = {name: fields[name] for name in fields.keys() - {"force_n", "relative_residual", "shear"}}
    host = {name: value.cpu().numpy() for name, value in fields.items()}
    same = all(bool((getattr(again, name) == value).all()) for name, value in fields.items())
    single = all(bool((getattr(alone, name)[0] == value[3]).all()) for name, value in fields.items())
    worst = dict.fromkeys(("pose", "offset_m", "depth_um_where_masks_agree", "rgb_levels"), 0.0)
    pixels = masks = brighter = reach = 0
    for index, file in enumerate(files):
        rows = np.flatnonzero(which == index)
        true = file.press(points[rows], **{name: value[rows] for name, value in settings.items()})
        differs = host["mask"][rows] != true.mask
        levels = np.abs(host["rgb"][rows].astype(int) - true.rgb)
        depth = np.abs(host["depth_m"][rows].astype(float) - true.depth_m)[~differs]
        masks, pixels = masks + int(differs.sum()), pixels + differs.size
        brighter += int((levels > 1).sum())
        reach += int((host["reachable"][rows] != true.reachable).sum())
        for name, value in (
            ("pose", np.abs(host["sensor_to_object"][rows] - true.sensor_to_object).max()),
            ("offset_m", np.abs(host["first_contact_offset_m"][rows] - true.first_contact_offset_m).max()),
            ("depth_um_where_masks_agree", 1e6 * depth.max()),
            ("rgb_levels", levels.max()),
        ):
            worst[name] = max(worst[name], float(value))
    return {
        "touches": count,
        "pixels": pixels,
        "mask_pixels_that_differ": masks,
        "share_above_one_level": brighter / (3 * pixels),
        "reachable_that_differ": reach,
        **worst,
        "same_bytes_twice": same,
        "alone_as_in_batch": single,
    }


def touch_speed(run: Run, precision: str) -> dict[str, Any]:
    """Touches a second: looked through the gel at given poses, and from points on."""
    from objectfolder.batch import Batch, TouchImages

    files = objects()
    batch = Batch(files, run.device, precision=precision).touch
    rates: dict[str, Any] = {}
    for count in run.batches:
        which, points, settings = touches(count, files)
        out = TouchImages.empty(count, batch.sensor, run.device)
        place = run.torch.as_tensor
        at = place(which, device=run.device), place(points, device=run.device)
        numbers = {name: place(value, device=run.device) for name, value in settings.items()}
        poses = batch.press(*at, **numbers, out=out).sensor_to_object
        see = run.seconds(partial(batch.see, at[0], poses, out=out))
        press = run.seconds(partial(batch.press, *at, **numbers, out=out))
        rates[str(count)] = {
            "see_per_s": round(count / see, 1),
            "press_per_s": round(count / press, 1),
            "touched": float((out.mask.flatten(1).any(1)).float().mean()),
        }
    return {**rates, "peak_gib": run.peak_gib()}
