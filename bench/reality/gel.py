"""The elastic gel against measured ones: the force of a GelSight Mini, and how markers move."""

import csv
from pathlib import Path

import numpy as np
from PIL import Image
from trimesh.creation import icosphere

from bench.reality.row import Aim, Row
from bench.record import cpu_seconds
from objectfolder.surface.surface import Surface
from objectfolder.touch import Elastomer, Press, press, read_sensor, solve_contact, solve_shear, unsheared
from objectfolder.touch.sensor.magnification import at_magnification
from objectfolder.touch.sensor.marker_tracking import track_markers

BALL_RADIUS_M = 0.0075
# Depths from which the preset's modulus was identified.
FITTED_MM = (0.5, 2.0)
FEATS = (
    "E. Helmut, L. Dziarski, N. Funk, B. Belousov, J. Peters 2024, arXiv:2411.03315; values of "
    "github.com/feats-ai/feats at f15e158 (MIT)"
)
# Of the picture: where the ball presses (column and row, by eye), and its scale. The contact is as wide as
# the ball's 21 photographs have it in the median.
MARKER_CENTRE, PIXELS_A_MM = (141.0, 121.0), 19.58
MARKER_BALL_MM, MARKER_CONTACT_M = 4.70, 41 / 19.58e3
PRESS_STEP_M = 5e-5
PIXEL_UM = 51.0  # in which shifts are measured
FOTS = "github.com/Rancho-zhao/FOTS at 5bcde04 (MIT)"


def force_rows(measured: Path) -> list[Row]:
    """Compare the force of `gelsight-mini` at the depths of ``mini_force.csv``; see `Row`."""
    start = cpu_seconds()
    with measured.open(encoding="utf-8", newline="") as lines:
        rows = [(float(row["depth_mm"]), float(row["measured_newtons"])) for row in csv.DictReader(lines)]
    depth_mm, newtons = np.array(rows).T
    point = np.tile([[0.0, 0.0, BALL_RADIUS_M]], (len(rows), 1))
    ball = icosphere(6, BALL_RADIUS_M)
    request = Press(depth_m=depth_mm * 1e-3, contact="elastic", samples=1)
    touches = press(Surface(ball.vertices, ball.faces), read_sensor("gelsight-mini"), point, request)
    error = 100 * (touches.force_n / newtons - 1)
    fitted = np.isin(depth_mm, FITTED_MM)
    row = Row(
        sense="touch",
        thing="GelSight Mini, force sensor",
        quantity="force on a ball of 15 mm, per cent",
        figures={
            **{f"at {depth:g} mm": value for depth, value in zip(depth_mm, error, strict=True)},
            "worst held out": np.abs(error[~fitted]).max(),
        },
        repeatability="",
        fitted="Young's modulus, to 0.5 and 2 mm",
        held_out="1 and 1.5 mm",
        source=FEATS,
        cpu_s=cpu_seconds() - start,
        aims=(Aim("worst held out", most=3.0),),
    )
    return [row]


def _tracking_row(measured: Path) -> Row:
    """Compare the dots that `objectfolder calibrate` follows with those that are listed."""
    from scipy.spatial import cKDTree

    start = cpu_seconds()
    pictures = np.stack([np.asarray(Image.open(measured / f"{name}.png").convert("RGB")) for name in (0, 4)])
    sensor = at_magnification(read_sensor("gelsight").at_resolution(*pictures.shape[1:3]), PIXELS_A_MM * 1e3)
    tracking = track_markers(pictures[1:], pictures[0], sensor)
    if tracking is None:
        raise RuntimeError("no grid of markers in the photograph 0.png")
    column, row, right, down = np.loadtxt(measured / "4.csv", delimiter=",", skiprows=1).T
    # Whole pixels, rounded down.
    listed = np.stack([row + down, column + right], axis=1) + 0.5
    dots = tracking.pixels[0][np.isfinite(tracking.pixels[0, :, 0])]
    away = cKDTree(dots).query(listed)[0]
    return Row(
        sense="touch",
        thing="markers of a GelSight",
        quantity="dots under a ball, followed as by `objectfolder calibrate`; distance in pixels",
        figures={
            "listed": float(len(listed)),
            "followed": float(len(dots)),
            "median": float(np.median(away)),
            "rms": float(np.sqrt((away**2).mean())),
        },
        repeatability="whole pixels",
        fitted="nothing",
        held_out="all dots of one photograph, from another",
        source=FOTS,
        cpu_s=cpu_seconds() - start,
    )


def marker_rows(measured: Path) -> list[Row]:
    """Compare how far a pressed ball spreads the markers under and round it; see `Row`.

    Neither force nor depth is known. The depth is the one at which the contact is as wide as those of the
    same ball in other photographs, and the camera's perspective is in the product's figures.
    """
    start = cpu_seconds()
    with (measured / "0.csv").open(encoding="utf-8", newline="") as lines:
        markers = np.array([[float(value) for value in row.values()] for row in csv.DictReader(lines)])
    away = (markers[:, :2] - MARKER_CENTRE) / PIXELS_A_MM
    distance = np.hypot(*away.T)
    moved = (markers[:, 2:] - np.median(markers[distance > 5][:, 2:], axis=0)) / PIXELS_A_MM
    with np.errstate(invalid="ignore"):
        outward = np.sum(moved * away, axis=1) / distance
    sensor, x = read_sensor("gelsight-mini"), (np.arange(96) - 47.5) * 1e-4
    gel = Elastomer(sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio, sensor.gel_thickness_m)
    square = x[:, None] ** 2 + x**2
    radius = MARKER_BALL_MM * 5e-4
    gap = np.where(square < radius**2, radius - np.sqrt(np.maximum(radius**2 - square, 0.0)), np.inf)
    state = unsheared(gap.shape)
    for depth in np.arange(1, round(sensor.gel_thickness_m / PRESS_STEP_M)) * PRESS_STEP_M:
        contact = solve_contact(gap, x[1] - x[0], gel, indentation_m=depth)
        state = solve_shear(contact, gel, 1.0, (0.0, 0.0), before=state, tolerance=1e-3)
        if contact.contact_area_m2 > np.pi * MARKER_CONTACT_M**2:
            break
    else:
        raise RuntimeError("the ball's contact is not as wide as measured at any depth of the gel")
    slipping = solve_shear(contact, gel, 0.0, (0.0, 0.0))
    nearer = contact.displacement_m[48, 48:]
    perspective = x[48:] * nearer / (sensor.gel_apex_m[0] - nearer)
    figures = {}
    for name, low, high in (("inside", 0.2, 1.7), ("at the rim", 1.7, 2.3), ("outside", 2.3, 5.0)):
        ring = (distance > low) & (distance < high)
        figures[f"{name}, measured"] = 1e3 * float(outward[ring].mean())
        for friction, shear in (("no friction", slipping), ("friction 1", state)):
            along = np.interp(distance[ring] * 1e-3, x[48:], shear.displacement_m[1, 48, 48:] + perspective)
            figures[f"{name}, {friction}"] = 1e6 * float(along.mean())
        figures[f"{name}, off"] = figures[f"{name}, friction 1"] - figures[f"{name}, measured"]
    row = Row(
        sense="touch",
        thing="markers of a GelSight",
        quantity="outward shift under a ball of 4.7 mm, micrometres",
        figures=figures,
        repeatability=f"whole pixels, {PIXEL_UM:g} micrometres",
        fitted="depth, to the width of the contact",
        held_out="all shifts; indicative, as the force is not known",
        source=FOTS,
        cpu_s=cpu_seconds() - start,
        aims=tuple(Aim(f"{name}, off", most=PIXEL_UM) for name in ("inside", "at the rim", "outside")),
    )
    return [row, _tracking_row(measured)]
