"""The command for one's own tactile sensors: calibrate."""

from dataclasses import replace
from pathlib import Path

from pipeline.cli.options import Json, Output
from pipeline.cli.output_paths import check_new_file
from pipeline.cli.printing import FINE, print_text, status_line


def calibrate(
    *photographs: Path,
    ball: float,
    output: Output = Path("sensor.yaml"),
    untouched: Path | None = None,
    sensor: str = "digit",
    pixels_per_mm: float | None = None,
    overwrite: bool = False,
    json: Json = False,
) -> int:
    """Calibrate one's own tactile sensor by photographs of a ball pressed into its gel.

    Centre and contact circle of each photograph are found; those without are named. A photometric table is
    fitted, and how the light changes round a contact; and the grid of dark markers, if the gel has one. The
    sensor is written as a file that `sensor` of params.yaml names, with table and response beside it.

    Parameters
    ----------
    photographs
        pictures of one size, or a folder of them
    ball
        diameter of the ball, millimetres
    output
        the sensor's file (YAML)
    untouched
        picture of the untouched sensor (default: the one called background or untouched)
    sensor
        what the sensor is like otherwise: gel, housing, camera; a name or a file
    pixels_per_mm
        magnification of the photographs at the gel (default: that of --sensor)
    overwrite
        replace files that are there
    """
    from objectfolder.making.sensor.own_calibration import calibrate as calibrated
    from objectfolder.touch.sensor.magnification import at_magnification
    from objectfolder.touch.sensor.sensor_file import read_sensor, write_sensor
    from pipeline.intake.sensor_photographs import calibration_json, calibration_text, read_photographs

    check_new_file(output, overwrite=overwrite)
    shots = read_photographs(photographs, untouched)
    for fault in () if json else shots.faults:
        print_text(fault)
    base = read_sensor(sensor).at_resolution(*shots.untouched.shape[:2])
    if pixels_per_mm is not None:
        base = at_magnification(base, pixels_per_mm * 1e3)
    with status_line("calibrating"):
        answer = calibrated(shots.pictures, shots.untouched, base, ball / 2e3)
    text = calibration_text(answer, shots.names)
    print_text(calibration_json(answer, shots) if json else text)
    own_sensor = replace(answer.sensor, name=output.stem)
    write_sensor(output, own_sensor, f"Calibrated by a ball of {ball:g} mm, otherwise as {sensor}.\n{text}")
    if not json:
        print_text(f"{output}, {output.with_suffix('.npy').name}, {output.stem}-response.npy")
    return FINE
