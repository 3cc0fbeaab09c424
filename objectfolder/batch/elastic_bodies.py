"""What an elastic gel needs of each cell and pixel: heights over it, steps of pressure, the deformed gel.

Touches are in pairs, the one's numbers between the other's: a pressure, displacement or gap of a touch is at
``[touch // 2, row, column, touch % 2]``. So they are real and imaginary parts of one complex array.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections import namedtuple
from functools import lru_cache
from typing import Any

import numpy as np

from objectfolder.batch.contact_bodies import Near, Presses, Surfaces, _span, tree_of
from objectfolder.batch.pixels import Images, Lamps, Table, photometric_table, point_lights
from objectfolder.batch.targets import Body, scalar
from objectfolder.touch.contact.tree_queries import near_gel
from objectfolder.touch.elastic.membrane import LEAST_APPROACH, NEWTON_STEPS, UNMOVED_M, UNMOVED_SLOPE
from objectfolder.touch.elastic.object_slopes import STEEPEST_WALL

# Of a face: weights of its corners, and its height, along 1, y and z; least and greatest height; normals.
FORMS = 23
# How far outside a face, in parts of it, a cell still meets it; heights of cells without a face, metres.
FACE_SLACK = {np.float32: 1e-6, np.float64: 1e-12}
NOTHING_M = 1.0

# The gel's cells; of each face near the gel its `FORMS` numbers, and rows and columns of cells.
# `grid` is y and z of the first cell, their pitches, columns and rows; heights count from the gel's apex.
Forms = namedtuple("Forms", "grid forms windows")
# The gel's cells as of `Forms`; its radius and stretch, the near plane behind the apex, the slack.
GelCells = namedtuple("GelCells", "grid shape")
# Samples along a pixel; slopes of rays; depth and value of the undeformed gel along them.
GelRays = namedtuple("GelRays", "samples u v gel_depth gel_values")
# The camera from the gel's apex and its near plane, the apex, and steps of depth a metre.
Eye = namedtuple("Eye", "eye apex steps")


def _lean(
    touch, presses: Presses, surfaces: Surfaces, gel, margins, near_gels: Near, cells: Forms, box
):  # fmt: skip
    """Write of each face near the gel what its cells need, and the rows and columns that it may cover."""
    objects, poses, blocked, starts = presses
    (bounds, faces, corners), (grid, forms, windows) = near_gels, cells
    tree, first_face = tree_of(surfaces, objects[touch])
    start, end, pose, count = starts[touch], starts[touch + 1], poses[touch], 0
    if not blocked[touch]:
        count = near_gel(
            tree, pose, gel, -margins[touch], box, faces[start:end], corners[start:end], bounds[start:end]
        )
    for k in range(start, end):
        windows[k, 0], windows[k, 1], windows[k, 2], windows[k, 3] = 1, 0, 1, 0
        if k - start >= count:
            continue
        corner = corners[k]
        for i in range(3):
            for axis in range(3):
                corner[i, axis] -= gel[axis]
        first = (corner[1, 1] - corner[0, 1]) * (corner[2, 2] - corner[0, 2])
        area = first - (corner[2, 1] - corner[0, 1]) * (corner[1, 2] - corner[0, 2])
        if area == 0 or not math.isfinite(1 / area):
            continue
        for term in range(3):
            forms[k, 9 + term] = 0.0
        for i in range(3):
            b, c = corner[(i + 1) % 3], corner[(i + 2) % 3]
            forms[k, 3 * i] = (b[1] * c[2] - b[2] * c[1]) / area
            forms[k, 3 * i + 1] = (b[2] - c[2]) / area
            forms[k, 3 * i + 2] = (c[1] - b[1]) / area
            # Heights from the first corner on: rounding is that of the face, not of its distance.
            for term in range(3):
                forms[k, 9 + term] += corner[i, 0] * forms[k, 3 * i + term]
            normal = surfaces.corner_normals[first_face + faces[k], i]
            for axis in range(3):
                forms[k, 14 + 3 * i + axis] = (
                    normal[0] * pose[0, axis] + normal[1] * pose[1, axis] + normal[2] * pose[2, axis]
                )
        forms[k, 12] = min(min(corner[0, 0], corner[1, 0]), corner[2, 0])
        forms[k, 13] = max(max(corner[0, 0], corner[1, 0]), corner[2, 0])
        windows[k, 0], windows[k, 1] = _span(
            corner[0, 2], corner[1, 2], corner[2, 2], grid[1], grid[3], 1, grid[5]
        )
        windows[k, 2], windows[k, 3] = _span(
            corner[0, 1], corner[1, 1], corner[2, 1], grid[0], grid[2], 1, grid[4]
        )


def _gap(touch, place, starts, windows, forms, cells: GelCells, gaps, slopes):
    """Write the object's height over a cell of gel, and how it leans there; see `height_field.gap_field`."""
    grid, shape = cells
    real = grid.dtype.type
    columns = slopes.shape[2]
    i, j = place // columns, place % columns
    y, z = grid[0] + real(j) * grid[2], grid[1] + real(i) * grid[3]
    lowest, owner = real(NOTHING_M), -1
    for k in range(starts[touch], starts[touch + 1]):
        window = windows[k]
        if i < window[0] or i > window[1] or j < window[2] or j > window[3]:
            continue
        form = forms[k]
        a = form[0] + form[1] * y + form[2] * z
        b = form[3] + form[4] * y + form[5] * z
        c = form[6] + form[7] * y + form[8] * z
        if a >= -shape[3] and b >= -shape[3] and c >= -shape[3]:
            x = min(max(form[9] + form[10] * y + form[11] * z, form[12]), form[13])
            if x >= shape[2] and x < lowest:
                lowest, owner = x, k
    lean_y, lean_z = real(np.inf), real(np.inf)
    if owner >= 0:
        form = forms[owner]
        a = form[0] + form[1] * y + form[2] * z
        b = form[3] + form[4] * y + form[5] * z
        c = form[6] + form[7] * y + form[8] * z
        nx = a * form[14] + b * form[17] + c * form[20]
        lean_y = -(a * form[15] + b * form[18] + c * form[21]) / nx
        lean_z = -(a * form[16] + b * form[19] + c * form[22]) / nx
        q = y * y + z * z
        lowest += shape[1] * q / (shape[0] + math.sqrt(shape[0] * shape[0] - q))
    gaps[touch // 2, i, j, touch % 2] = lowest
    slopes[touch, i, j, 0], slopes[touch, i, j, 1] = lean_y, lean_z


def _exceed(pair, lane, pressure, displacement, gaps, state, sums):
    """Write by how much a column of a step would exceed a shift of pressure, and of how many cells.

    `state` of a touch is step length, indentation, shift.
    """
    column, side = lane // 2, lane % 2
    touch, real = 2 * pair + side, state.dtype.type
    step, reach, shift = state[touch, 0], state[touch, 1], state[touch, 2]
    total, count = real(0), real(0)
    for i in range(gaps.shape[1]):
        left = displacement[pair, i, column, side] + gaps[pair, i, column, side] - reach
        over = pressure[pair, i, column, side] - step * left - shift
        if over > real(0):
            total, count = total + over, count + real(1)
    sums[touch, column, 0], sums[touch, column, 1] = total, count


def _descend(pair, lane, pressure, displacement, gaps, state, moved):
    """Write a column of pressures after a step, none below 0."""
    column, side = lane // 2, lane % 2
    touch, real = 2 * pair + side, state.dtype.type
    step, reach, shift = state[touch, 0], state[touch, 1], state[touch, 2]
    for i in range(gaps.shape[1]):
        left = displacement[pair, i, column, side] + gaps[pair, i, column, side] - reach
        moved[pair, i, column, side] = max(pressure[pair, i, column, side] - step * left - shift, real(0))


def _compare(pair, lane, pressure, displacement, moved, displaced, gaps, sums):
    """Write of a column what the next step's length and indentation follow from."""
    column, side = lane // 2, lane % 2
    touch, real = 2 * pair + side, sums.dtype.type
    work, squared, left, count = real(0), real(0), real(0), real(0)
    for i in range(gaps.shape[1]):
        p, u = moved[pair, i, column, side], displaced[pair, i, column, side]
        change = u - displacement[pair, i, column, side]
        work += (p - pressure[pair, i, column, side]) * change
        squared += change * change
        if p > real(0):
            left, count = left + u + gaps[pair, i, column, side], count + real(1)
    sums[touch, column, 0], sums[touch, column, 1] = work, squared
    sums[touch, column, 2], sums[touch, column, 3] = left, count


def _deform(touch, place, pressure, displacement, slopes, grid, shape, fields):
    """Write displacement, slopes and touch of a cell: `membrane.membrane_fields`."""
    real = grid.dtype.type
    rows, columns = fields.shape[1], fields.shape[2]
    i, j = place // columns, place % columns
    pair, side = touch // 2, touch % 2
    up, down = max(i - 1, 0), min(i + 1, rows - 1)
    left, right = max(j - 1, 0), min(j + 1, columns - 1)
    dz = displacement[pair, down, j, side] - displacement[pair, up, j, side]
    dy = displacement[pair, i, right, side] - displacement[pair, i, left, side]
    slope_y, slope_z = dy / (real(right - left) * grid[2]), dz / (real(down - up) * grid[3])
    touched = pressure[pair, i, j, side] > real(0)
    if touched:
        lean_y, lean_z = slopes[touch, i, j, 0], slopes[touch, i, j, 1]
        if lean_y * lean_y + lean_z * lean_z < real(STEEPEST_WALL * STEEPEST_WALL):
            y, z = grid[0] + real(j) * grid[2], grid[1] + real(i) * grid[3]
            scale = -shape[1] / math.sqrt(shape[0] * shape[0] - y * y - z * z)
            slope_y, slope_z = scale * y - lean_y, scale * z - lean_z
    fields[touch, i, j, 0] = displacement[pair, i, j, side]
    fields[touch, i, j, 1], fields[touch, i, j, 2] = slope_y, slope_z
    fields[touch, i, j, 3] = real(1) if touched else real(0)


@scalar
def _cell(fields, grid, y, z):
    """As `membrane._cell`, of a place from the gel's apex."""
    real = grid.dtype.type
    rows, columns = fields.shape[1], fields.shape[2]
    row = min(max((z - grid[1]) / grid[3], real(0)), real(rows - 1))
    column = min(max((y - grid[0]) / grid[2], real(0)), real(columns - 1))
    top, left = min(int(row), rows - 2), min(int(column), columns - 2)
    return top, left, row - real(top), column - real(left)


@scalar
def _bilinear(fields, touch, field, top, left, down, right):
    a, b = fields[touch, top, left, field], fields[touch, top, left + 1, field]
    c, d = fields[touch, top + 1, left, field], fields[touch, top + 1, left + 1, field]
    upper, lower = a + right * (b - a), c + right * (d - c)
    return upper + down * (lower - upper)


@scalar
def _meet(fields, touch, grid, shape, eye, ray, across, up):
    """Distance along a ray at which it meets the membrane: `membrane._meet`.

    `eye` is the camera from the gel's apex.
    """
    real = grid.dtype.type
    one = real(1)
    for _ in range(NEWTON_STEPS):
        y, z = eye[1] + ray * across, eye[2] + ray * up
        top, left, down, right = _cell(fields, grid, y, z)
        a, b = fields[touch, top, left, 0], fields[touch, top, left + 1, 0]
        c, d = fields[touch, top + 1, left, 0], fields[touch, top + 1, left + 1, 0]
        upper, lower = a + right * (b - a), c + right * (d - c)
        slope_y = (b - a + down * (d - c - b + a)) / grid[2]
        slope_z = (lower - upper) / grid[3]
        q = y * y + z * z
        root = math.sqrt(shape[0] * shape[0] - q)
        surface = -shape[1] * q / (shape[0] + root) - (upper + down * (lower - upper))
        tilt = -shape[1] / root
        approach = one - (tilt * y - slope_y) * across - (tilt * z - slope_z) * up
        ray = max(ray - (eye[0] + ray - surface) / max(approach, real(LEAST_APPROACH)), eye[3])
    return ray


def _membrane(shade: Any, lighting: Any) -> Any:
    def membrane(
        touch, place, fields, rays: GelRays, cells: GelCells, view: Eye, light: lighting, images: Images
    ):  # fmt: skip
        samples, u, v, gel_depth, gel_values = rays
        (grid, shape), (eye, apex, steps), (rgb, depth, mask) = cells, view, images
        camera, real = light.camera, grid.dtype.type
        zero, one = real(0), real(1)
        width = rgb.shape[2]
        i, j = place // width, place % width
        red, green, blue, total, covered = zero, zero, zero, zero, 0
        for sample in range(samples * samples):
            row, column = i * samples + sample // samples, j * samples + sample % samples
            across, up, ray = u[column], v[row], gel_depth[row, column]
            value = gel_values[row, column]
            r, g, b = value[0], value[1], value[2]
            y, z = eye[1] + ray * across, eye[2] + ray * up
            top, left, down, right = _cell(fields, grid, y, z)
            moved = abs(_bilinear(fields, touch, 0, top, left, down, right)) > real(UNMOVED_M)
            slope = abs(_bilinear(fields, touch, 1, top, left, down, right))
            slope += abs(_bilinear(fields, touch, 2, top, left, down, right))
            if moved or slope > real(UNMOVED_SLOPE):
                ray = _meet(fields, touch, grid, shape, eye, ray, across, up)
                y, z = eye[1] + ray * across, eye[2] + ray * up
                top, left, down, right = _cell(fields, grid, y, z)
                tilt = -shape[1] / math.sqrt(shape[0] * shape[0] - y * y - z * z)
                ny = tilt * y - _bilinear(fields, touch, 1, top, left, down, right)
                nz = tilt * z - _bilinear(fields, touch, 2, top, left, down, right)
                total += _bilinear(fields, touch, 0, top, left, down, right)
                covered += _bilinear(fields, touch, 3, top, left, down, right) >= real(0.5)
                r, g, b = shade((camera[0] + ray, apex[1] + y, apex[2] + z), (-one, ny, nz), light)
            red, green, blue = red + r, green + g, blue + b
        share, scale, half = one / real(samples * samples), real(255), real(0.5)
        rgb[touch, i, j, 0] = np.uint8(red * share * scale + half)
        rgb[touch, i, j, 1] = np.uint8(green * share * scale + half)
        rgb[touch, i, j, 2] = np.uint8(blue * share * scale + half)
        depth[touch, i, j] = np.float32(real(np.int32(total * share * steps[0])) / steps[0])
        mask[touch, i, j] = 2 * covered >= samples * samples

    return membrane


lean = Body(_lean, box=((6,), np.float64))
gap, deform = Body(_gap, 2), Body(_deform, 2)
exceed, descend, compare = Body(_exceed, 2), Body(_descend, 2), Body(_compare, 2)


@lru_cache(maxsize=2)
def membrane_body(table: bool) -> Body:
    """Return the body of pixels for a photometric table or point lights."""
    return Body(_membrane(photometric_table, Table) if table else _membrane(point_lights, Lamps), 2)
