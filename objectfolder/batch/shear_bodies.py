"""What a sheared gel needs of each column of cells, and a picture of each pixel: tractions, dots of markers.

Fields of a touch are at ``[touch, row, column, direction]``; directions are those of `shear.Shear`.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections import namedtuple

import numpy as np

from objectfolder.batch.targets import Body, scalar
from objectfolder.touch.elastic.shear import limited_traction

# Numbers of a touch: step, lift (3), centre of pressure (2), lever, and `SLIPPING` or 0.
STATE = 8
# Of the curvature that slipping takes away, the part that Newton's method sees: its steps are then at most
# ten times those that never overshoot.
SLIPPING = 0.9
# Sums of a column: slope (3), curvature (3, 3).
SUMS = 12

# Tractions, their displacements and limits; `STATE` numbers of each touch; pitches of rows and columns.
Slipping = namedtuple("Slipping", "traction displacement limit state pitch")


@scalar
def _lifted(touch, i, column, cells):
    """Arm of a cell, its limit, and the traction that step and lift give; as of `shear._Load`."""
    state = cells.state[touch]
    real = state.dtype.type
    e = (state[5] - real(column) * cells.pitch[1]) / state[6]
    f = (real(i) * cells.pitch[0] - state[4]) / state[6]
    a = cells.traction[touch, i, column, 0] - state[0] * cells.displacement[touch, i, column, 0]
    b = cells.traction[touch, i, column, 1] - state[0] * cells.displacement[touch, i, column, 1]
    return e, f, cells.limit[touch, i, column], a + state[1] + state[3] * e, b + state[2] + state[3] * f


def _balance(touch, column, cells: Slipping, sums):
    """Write a column's part of the slope and curvature of what the lift makes least: `shear._cut`."""
    real = sums.dtype.type
    zero, one = real(0), real(1)
    x, y, turn, xx, xy, yy, xt, yt, tt = zero, zero, zero, zero, zero, zero, zero, zero, zero
    keen = cells.state[touch, 7]
    for i in range(cells.limit.shape[1]):
        e, f, most, a, b = _lifted(touch, i, column, cells)
        if most > zero:
            _, share, c, d = limited_traction(a, b, most, one)
            a, b = share * a, share * b
            x, y, turn = x + a, y + b, turn + a * e + b * f
            p, q, r = share * (one - keen * c * c), -share * keen * c * d, share * (one - keen * d * d)
            xx, xy, yy = xx + p, xy + q, yy + r
            xt, yt, tt = (
                xt + p * e + q * f,
                yt + q * e + r * f,
                tt + (p * e + q * f) * e + (q * e + r * f) * f,
            )
    row = sums[touch, column]
    row[0], row[1], row[2] = x, y, turn
    row[3], row[4], row[5], row[6], row[7], row[8] = xx, xy, xt, xy, yy, yt
    row[9], row[10], row[11] = xt, yt, tt


def _restrain(touch, column, cells: Slipping, moved):
    """Write the tractions of a column that step and lift give, cut to their limits."""
    real = moved.dtype.type
    for i in range(moved.shape[1]):
        _, _, most, a, b = _lifted(touch, i, column, cells)
        share = real(0)
        if most > real(0):
            _, share, _, _ = limited_traction(a, b, most, real(1))
        moved[touch, i, column, 0], moved[touch, i, column, 1] = share * a, share * b


def _dot(picture, place, pixels, radius, rgb, drawn):
    """Write a pixel beneath black dots at pixels (n, markers, 2): `Markers.drawn_on`."""
    real = pixels.dtype.type
    width = rgb.shape[2]
    i, j = place // width, place % width
    light = real(1)
    for marker in range(pixels.shape[1]):
        down, right = real(i) - pixels[picture, marker, 0], real(j) - pixels[picture, marker, 1]
        away = math.sqrt(down * down + right * right) - radius[0]
        light = min(light, max(away, real(0)))
    for channel in range(3):
        drawn[picture, i, j, channel] = np.uint8(real(rgb[picture, i, j, channel]) * light + real(0.5))


balance, restrain, dot = Body(_balance, 2), Body(_restrain, 2), Body(_dot, 2)
