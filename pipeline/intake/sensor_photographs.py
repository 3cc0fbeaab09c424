"""Photographs of one's own tactile sensor, from files that may be anything, and what calibration says."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from objectfolder.errors import InputError
from objectfolder.making.sensor.ball_prints import Print
from objectfolder.making.sensor.own_calibration import OwnCalibration
from objectfolder.products.regular_file import open_regular
from objectfolder.touch.sensor.marker_tracking import Tracking

SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"}
# Names, without suffix, of the picture of the untouched sensor in a folder.
UNTOUCHED = ("background", "untouched")


@dataclass(frozen=True, eq=False)
class SensorPhotographs:
    """Photographs of one size.

    Parameters
    ----------
    names, pictures
        Of those that can be used: (n,) file names and (n, height, width, 3) uint8.
    untouched
        (height, width, 3) uint8.
    faults
        A line for each of the others.
    """

    names: list[str]
    pictures: np.ndarray
    untouched: np.ndarray
    faults: list[str]


def read_photographs(sources: Sequence[Path], untouched: Path | None = None) -> SensorPhotographs:
    """Read photographs from files and folders; those of another size than the untouched one are left out.

    Parameters
    ----------
    untouched
        The picture of the untouched sensor; by default that among the others which is called so.

    Raises
    ------
    InputError
        A file or folder that is not there, no picture of the untouched sensor, or none that can be used
        beside it.
    """
    paths: list[Path] = []
    for path in sources:
        if not path.exists():
            raise InputError("photographs", f"{path} is not there", "Give files or a folder.")
        inside = (
            sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
            if path.is_dir()
            else [path]
        )
        paths += inside
    if untouched is None:
        untouched = next((path for path in paths if path.stem.lower() in UNTOUCHED), None)
    if untouched is None:
        file_names = " or ".join(f"{name}.png" for name in UNTOUCHED)
        raise InputError(
            "photographs",
            "no picture shows the untouched sensor",
            f"Name it {file_names}, or give --untouched.",
        )
    empty = _picture(untouched)
    height, width = empty.shape[:2]
    names: list[str] = []
    pictures: list[np.ndarray] = []
    faults: list[str] = []
    for path in paths:
        if path.resolve() == untouched.resolve():
            continue
        try:
            picture = _picture(path)
        except InputError as error:
            faults.append(str(error))
            continue
        if picture.shape != empty.shape:
            size = f"{picture.shape[1]} x {picture.shape[0]}"
            faults.append(f"{path.name}: {size} pixels, the untouched one has {width} x {height}. Left out.")
            continue
        if not np.ptp(picture, axis=(0, 1)).any():
            faults.append(f"{path.name}: of one colour all over. Left out.")
            continue
        names.append(path.name)
        pictures.append(picture)
    if not pictures:
        raise InputError(
            "photographs", "none that can be used", " ".join(faults) or "Give files or a folder."
        )
    return SensorPhotographs(names, np.stack(pictures), empty, faults)


def calibration_text(calibration: OwnCalibration, names: Sequence[str]) -> str:
    """Return what a calibration found and how far it is from the photographs, a line each."""
    lines = [
        f"{name}: {circle}. Left out."
        if isinstance(circle, str)
        else f"{name}: centre {circle.column:.0f}, {circle.row:.0f}, radius {circle.radius:.0f} pixels"
        + _followed(calibration.markers, index)
        for index, (name, circle) in enumerate(zip(names, calibration.prints, strict=True))
    ]
    lines.append(_grid(calibration.markers))
    used = sum(isinstance(circle, Print) for circle in calibration.prints)
    lines.append(
        f"{used} of {len(names)} photographs used; PSNR in the contact circle of every second one, dB:"
    )
    figures = (
        ("fitted to the others", calibration.held_out),
        ("the same, with what is round", calibration.held_out_around),
        ("mean patch of the others", calibration.mean_patch),
        ("untouched picture", calibration.nothing),
        ("two photographs of one press", calibration.repeatability),
    )
    for name, values in figures:
        value = f"{values.mean():5.1f}, worst {values.min():5.1f}" if len(values) else "no two are alike"
        lines.append(f"  {name:<29} {value}")
    slopes = np.linspace(0, 90, len(calibration.uncertainty))
    error = calibration.uncertainty.mean(axis=1)
    steps = ", ".join(f"{slope:.0f}: {value:.0f}" for slope, value in zip(slopes, error, strict=True))
    lines.append(
        f"Slopes were shown up to {calibration.shown_deg:.0f} degrees. Expected error by slope, grey levels:"
    )
    lines.append(f"  {steps}")
    return "\n".join(lines)


def _followed(markers: Tracking | None, index: int) -> str:
    if markers is None:
        return ""
    count, most = markers.followed[index], markers.largest_shift_m[index]
    return f", {count} of {len(markers.rest_pixels)} markers, moved by {1e3 * most:.2f} mm at most"


def _grid(markers: Tracking | None) -> str:
    """What a grid of markers is like, and how regular."""
    if markers is None:
        return "No grid of dark markers in the untouched picture."
    grid = markers.grid
    return (
        f"Markers: {grid.rows} x {grid.columns}, {1e3 * grid.row_pitch_m:.3f} mm from row to row, "
        f"{1e3 * grid.column_pitch_m:.3f} from column to column, turned by {grid.rotation_deg:.1f} degrees, "
        f"of radius {1e3 * grid.dot_radius_m:.2f} mm; {len(markers.rest_pixels)} of "
        f"{grid.rows * grid.columns} there, {1e6 * markers.rms_m:.0f} um rms from the grid."
    )


def calibration_json(calibration: OwnCalibration, photographs: SensorPhotographs) -> str:
    """Return what `calibration_text` says, and the faults of photographs, as JSON."""
    figures = {
        name: getattr(calibration, name).round(2).tolist()
        for name in ("held_out", "held_out_around", "mean_patch", "nothing", "repeatability")
    }
    circles = {
        name: circle if isinstance(circle, str) else [circle.column, circle.row, circle.radius]
        for name, circle in zip(photographs.names, calibration.prints, strict=True)
    }
    uncertainty = calibration.uncertainty.mean(axis=1).round(2).tolist()
    markers = calibration.markers
    grid = markers and {
        **markers.grid.to_dict(), "rms_m": markers.rms_m, "dots": len(markers.rest_pixels),
        "followed": dict(zip(photographs.names, markers.followed.tolist(), strict=True)),
    }  # fmt: skip
    content = {
        "photographs": circles, "faults": photographs.faults, "psnr_db": figures,
        "shown_deg": round(calibration.shown_deg, 1), "uncertainty_grey_levels": uncertainty,
        "markers": grid,
    }  # fmt: skip
    return json.dumps(content, indent=1)


def _picture(path: Path) -> np.ndarray:
    try:
        with open_regular(path) as file, Image.open(file) as image:
            return np.asarray(image.convert("RGB"))
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(path.name, f"cannot be read ({error})", "Give a picture.") from error
