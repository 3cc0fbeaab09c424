"""The elastic gel against a measured one: the force on a ball pressed into a GelSight Mini."""

import csv
from pathlib import Path

import numpy as np
from trimesh.creation import icosphere

from bench.reality.row import Row
from bench.record import cpu_seconds
from objectfolder.surface.surface import Surface
from objectfolder.touch import Press, press, read_sensor

BALL_RADIUS_M = 0.0075
# Depths from which the preset's modulus was identified.
FITTED_MM = (0.5, 2.0)
FEATS = (
    "E. Helmut, L. Dziarski, N. Funk, B. Belousov, J. Peters 2024, arXiv:2411.03315; values of "
    "github.com/feats-ai/feats at f15e158 (MIT)"
)


def force_rows(measured: Path) -> list[Row]:
    """Compare the force of `gelsight-mini` at the depths of ``mini_force.csv``; see `Row`."""
    start = cpu_seconds()
    with measured.open(encoding="utf-8", newline="") as lines:
        rows = [(float(row["depth_mm"]), float(row["measured_newtons"])) for row in csv.DictReader(lines)]
    depth_mm, newtons = np.array(rows).T
    point = np.tile([[0.0, 0.0, BALL_RADIUS_M]], (len(rows), 1))
    ball = icosphere(6, BALL_RADIUS_M)
    asked = Press(depth_m=depth_mm * 1e-3, contact="elastic", samples=1)
    touches = press(Surface(ball.vertices, ball.faces), read_sensor("gelsight-mini"), point, asked)
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
    )
    return [row]
