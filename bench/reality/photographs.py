"""Photographs of real sensors, into which a ball of known size is pressed, against simulated touches."""

from pathlib import Path

import numpy as np
from PIL import Image
from trimesh.creation import icosphere

from bench.reality.row import Aim, Row
from bench.record import cpu_seconds
from objectfolder.making import calibrate
from objectfolder.making.sensor.ball_prints import Print
from objectfolder.making.sensor.own_calibration import OwnCalibration
from objectfolder.surface.surface import Surface
from objectfolder.touch import read_sensor
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.presses.press import render_poses
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.magnification import at_magnification, pixels_per_metre
from objectfolder.touch.sensor.reading import calibrated
from objectfolder.touch.sensor.sensor import Sensor

BALL_M = 0.00235
GELSIGHT_PIXELS_A_METRE = 19580.0
# Half the side of the window about a mark, pixels.
WINDOW = 70
SOURCE = "Zhao et al. 2024, FOTS (RA-L 9(5)); repository Rancho-zhao/FOTS, commit 5bcde04, MIT"
SECOND = "every second photograph"
# Steps of the search for where a touch lies in a photograph, metres.
SEARCH_M = (4e-4, 2e-4, 1e-4)


def digit_rows(folder: Path) -> list[Row]:
    """Compare with the photographs of a DIGIT; see `Row`."""
    start = cpu_seconds()
    sensor = read_sensor("digit").at_resolution(320, 240)
    pictures, untouched = _photographs(folder)
    calibration = calibrate(pictures, untouched, sensor, BALL_M)
    calibration_s = cpu_seconds() - start
    rows = [_calibrated("DIGIT of FOTS", calibration, calibration_s, ())]
    preset_aims = Aim("mean", least=23.0), Aim("correlation", least=0.85)
    own, ball = calibrate(pictures[::2], untouched, sensor, BALL_M).sensor, _ball()
    tacto = read_sensor("digit-tacto").at_resolution(320, 240)
    for preset, simulated, fitted, aims in (
        ("preset `digit`, no table", sensor, f"lights and shadows, {SECOND}", preset_aims),
        (
            "calibrated by `objectfolder calibrate`", own, f"a table and a response, {SECOND}",
            (Aim("mean", least=27.0),),
        ),
        ("preset `digit-tacto`, no table", tacto, "", ()),
    ):  # fmt: skip
        start = cpu_seconds()
        score = np.array(
            [
                _best_touch(ball, simulated, pictures[index], calibration, circle)
                for index, circle in enumerate(calibration.prints)
                if index % 2 and isinstance(circle, Print)
            ]
        )
        figures = {
            "mean": score[:, 0].mean(),
            "worst": score[:, 0].min(),
            "correlation": score[:, 1].mean(),
            "no touch": score[:, 2].mean(),
        }
        rows.append(
            Row(
                "touch", "DIGIT of FOTS", f"window of 140 pixels, {preset}, PSNR in dB",
                {name: float(value) for name, value in figures.items()}, _repeatability(calibration), fitted,
                f"{SECOND}; where the touch lies is found in each", SOURCE, cpu_seconds() - start,
                aims,
            )
        )  # fmt: skip
    return rows


def gelsight_rows(folder: Path) -> list[Row]:
    """Compare with the photographs of a GelSight; see `Row`."""
    base = at_magnification(read_sensor("gelsight").at_resolution(320, 240), GELSIGHT_PIXELS_A_METRE)
    pictures, untouched = _photographs(folder)
    rows = []
    for subset, fewer, aims in (
        (pictures, "", (Aim("mean", least=29.5), Aim("worst", least=26.0))),
        (pictures[::2], ", fitted to a quarter", (Aim("mean", least=26.5),)),
    ):
        start = cpu_seconds()
        calibration = calibrate(subset, untouched, base, BALL_M)
        rows.append(_calibrated(f"GelSight of FOTS{fewer}", calibration, cpu_seconds() - start, aims))
    return rows


def _ball() -> FacePatches:
    ball = icosphere(6, BALL_M)
    return FacePatches(Surface(ball.vertices, ball.faces))


def _photographs(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    paths = sorted(path for path in folder.glob("*.png") if path.stem != "background")
    images = [np.asarray(Image.open(path).convert("RGB")) for path in (*paths, folder / "background.png")]
    return np.stack(images[:-1]), images[-1]


def _repeatability(calibration: OwnCalibration) -> str:
    values = calibration.repeatability
    return f"{values.min():.1f} to {values.max():.1f} dB" if len(values) else ""


def _calibrated(thing: str, calibration: OwnCalibration, cpu_s: float, aims: tuple[Aim, ...]) -> Row:
    figures = {
        "mean": calibration.held_out.mean(),
        "worst": calibration.held_out.min(),
        "mean with what is round it": calibration.held_out_around.mean(),
        "worst with that": calibration.held_out_around.min(),
        "mean patch": calibration.mean_patch.mean(),
        "no touch": calibration.nothing.mean(),
    }
    used = sum(isinstance(circle, Print) for circle in calibration.prints)
    fitted = f"a table and a response, {used - len(calibration.held_out)} photographs"
    return Row(
        "touch", thing, "contact circle, calibrated by `objectfolder calibrate`, PSNR in dB",
        {name: float(value) for name, value in figures.items()}, _repeatability(calibration), fitted,
        f"{SECOND}; its circle is found in it", SOURCE, cpu_s, aims,
    )  # fmt: skip


def _best_touch(
    ball: FacePatches, sensor: Sensor, photo: np.ndarray, calibration: OwnCalibration, circle: Print
) -> tuple[float, float, float]:
    """PSNR and correlation of the change of the best touch in the window, and PSNR of no touch."""
    untouched, empty = calibration.untouched, no_contact_image(sensor)
    row, column = round(circle.row), round(circle.column)
    window = (
        slice(max(row - WINDOW, 0), row + WINDOW),
        slice(max(column - WINDOW, 0), column + WINDOW),
    )
    apex, scale = np.asarray(sensor.gel_apex_m), pixels_per_metre(sensor)

    def change(place: np.ndarray) -> np.ndarray:
        y, z = place[:2] + apex[1:]
        pose = np.eye(4)
        pose[:3, 3] = -np.array([float(gel_surface(sensor, y, z)) - place[2] + BALL_M, y, z])
        laid = calibrated(render_poses(ball, sensor, pose[None])[0].rgb, empty, untouched, sensor)
        return np.asarray((laid.astype(float) - untouched)[window])

    true = (photo.astype(float) - untouched)[window]

    def error(place: np.ndarray) -> float:
        return float(np.mean((change(place) - true) ** 2))

    best = np.array([-(column - 119.5) / scale, -(row - 159.5) / scale, 0.0012])
    least = error(best)
    for step in SEARCH_M:
        for axis in (0, 1, 2):
            for sign in (-1, 1):
                while True:
                    moved = best.copy()
                    moved[axis] += sign * step
                    value = error(moved) if 2e-4 < moved[2] < 2.2e-3 else np.inf
                    if value >= least:
                        break
                    best, least = moved, value
    correlation = np.corrcoef(change(best).ravel(), true.ravel())[0, 1]
    return 10 * np.log10(255**2 / least), float(correlation), 10 * np.log10(255**2 / np.mean(true**2))
