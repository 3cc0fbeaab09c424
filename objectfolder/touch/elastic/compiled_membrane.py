"""Counterpart of `membrane.trace_membrane`, compiled."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import kernel
from objectfolder.touch.elastic.membrane import (
    LEAST_APPROACH,
    NEWTON_STEPS,
    UNMOVED_M,
    UNMOVED_SLOPE,
    Membrane,
    Seen,
)
from objectfolder.touch.sensor.camera import RayGrid
from objectfolder.touch.sensor.sensor import Sensor


def trace_membrane(membrane: Membrane, sensor: Sensor, grid: RayGrid) -> Seen:
    """As `membrane.trace_membrane`."""
    gel = np.array(
        [
            *sensor.camera_position_m,
            *sensor.gel_apex_m,
            sensor.gel_width_m,
            sensor.gel_height_m,
            sensor.gel_radius_m,
            sensor.gel_stretch,
        ]
    )
    limits = (UNMOVED_M, UNMOVED_SLOPE, LEAST_APPROACH, grid.near)
    nodes = np.ascontiguousarray(np.moveaxis(membrane.fields, 0, -1))
    sample, position, normal, displacement, touched = _trace(
        nodes, gel, grid.u, grid.v, grid.gel_depth, limits, NEWTON_STEPS
    )
    return Seen(sample, np.ascontiguousarray(position), np.ascontiguousarray(normal), displacement, touched)


@kernel
def _cell(shape, gel, y, z):
    """Row and column of the first of the four centres round a place, and how far down and right it is."""
    row = (0.5 - (z - gel[5]) / gel[7]) * shape[0] - 0.5
    column = (0.5 - (y - gel[4]) / gel[6]) * shape[1] - 0.5
    row, column = min(max(row, 0.0), shape[0] - 1.0), min(max(column, 0.0), shape[1] - 1.0)
    top, left = min(int(row), shape[0] - 2), min(int(column), shape[1] - 2)
    return top, left, row - top, column - left


@kernel
def _bilinear(nodes, gel, y, z, at):
    top, left, down, right = _cell(nodes.shape, gel, y, z)
    for field in range(4):
        upper = (1 - right) * nodes[top, left, field] + right * nodes[top, left + 1, field]
        lower = (1 - right) * nodes[top + 1, left, field] + right * nodes[top + 1, left + 1, field]
        at[field] = (1 - down) * upper + down * lower


@kernel
def _meet(nodes, gel, across, up, ray, least_approach, near, steps):
    """Distance along a ray at which it meets the membrane."""
    for _ in range(steps):
        y, z = gel[1] + ray * across, gel[2] + ray * up
        top, left, down, right = _cell(nodes.shape, gel, y, z)
        a, b = nodes[top, left, 0], nodes[top, left + 1, 0]
        c, d = nodes[top + 1, left, 0], nodes[top + 1, left + 1, 0]
        upper, lower = a + right * (b - a), c + right * (d - c)
        down_y = (a - b + down * (c - d - a + b)) * (nodes.shape[1] / gel[6])
        down_z = (upper - lower) * (nodes.shape[0] / gel[7])
        y, z = y - gel[4], z - gel[5]
        root = np.sqrt(gel[8] * gel[8] - (y * y + z * z))
        surface = gel[3] - gel[9] * (gel[8] - root) - (upper + down * (lower - upper))
        slope_y, slope_z = -gel[9] / root * y, -gel[9] / root * z
        approach = 1 - (slope_y - down_y) * across - (slope_z - down_z) * up
        step = (gel[0] + ray - surface) / max(approach, least_approach)
        ray = max(ray - step, near)
        # Newton's next step would be of the order of the square of this one.
        if abs(step) < 1e-8:
            break
    return ray


@kernel
def _trace(nodes, gel, u, v, gel_depth, limits, steps):
    unmoved, unmoved_slope, least_approach, near = limits
    count = len(u) * len(v)
    sample = np.empty(count, np.int64)
    position, normal = np.empty((3, count), np.float32), np.empty((3, count), np.float32)
    displacement, touched = np.empty(count), np.empty(count, np.bool_)
    at = np.empty(4)
    found = 0
    for i in range(count):
        across, up = u[i % len(u)], v[i // len(u)]
        ray = gel_depth[i]
        _bilinear(nodes, gel, gel[1] + ray * across, gel[2] + ray * up, at)
        if abs(at[0]) <= unmoved and abs(at[1]) + abs(at[2]) <= unmoved_slope:
            continue
        ray = _meet(nodes, gel, across, up, ray, least_approach, near, steps)
        y, z = gel[1] + ray * across, gel[2] + ray * up
        _bilinear(nodes, gel, y, z, at)
        b, c = y - gel[4], z - gel[5]
        tilt = -gel[9] / np.sqrt(gel[8] * gel[8] - (b * b + c * c))
        sample[found] = i
        position[0, found], position[1, found], position[2, found] = gel[0] + ray, y, z
        normal[0, found], normal[1, found], normal[2, found] = -1.0, tilt * b - at[1], tilt * c - at[2]
        displacement[found] = at[0]
        touched[found] = at[3] >= 0.5
        found += 1
    return sample[:found], position[:, :found], normal[:, :found], displacement[:found], touched[:found]
