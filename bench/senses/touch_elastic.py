"""How many elastic contacts are solved in a CPU second, on 96 x 64 cells under presses of real objects."""

import time
from typing import Any

import numpy as np

from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.height_field import gap_field
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.elastic.contact_problem import solve_contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.truth.press import press
from objectfolder.touch.truth.touches import Press

CELLS = (96, 64)
DEPTHS_M = (0.0003, 0.0005, 0.001)
POINTS = 12


def measure_elastic(surface: Surface, name: str) -> dict[str, Any]:
    """Return the row of one object: contacts a CPU second, for a half-space and a bonded layer."""
    sensor, patches = Sensor(), FacePatches(surface)
    points = surface.sample(POINTS, 0).points
    touches = press(patches, sensor, points, Press(depth_m=0.0005, samples=1))
    pitch = (sensor.gel_height_m / CELLS[0], sensor.gel_width_m / CELLS[1])
    modulus, ratio = sensor.gel_youngs_modulus_pa, sensor.gel_poisson_ratio
    bodies = {
        "half-space": Elastomer(modulus, ratio),
        "layer": Elastomer(modulus, ratio, sensor.gel_thickness_m),
    }
    gaps = []
    for index in np.flatnonzero(touches.penetration_m > 0):
        first = touches.sensor_to_object[index].copy()
        first[:3, 3] -= touches.penetration_m[index] * first[:3, 0]
        gaps.append(gap_field(patches, sensor, first, CELLS))
    rows = []
    for body, gel in bodies.items():
        # Boxes of influence that the contacts share are made once.
        for gap in gaps:
            solve_contact(gap, pitch, gel, indentation_m=max(DEPTHS_M))
        for depth in DEPTHS_M:
            seconds, residuals, iterations = [], [], []
            for gap in gaps:
                start = time.process_time()
                found = solve_contact(gap, pitch, gel, indentation_m=depth)
                seconds.append(time.process_time() - start)
                residuals.append(found.relative_residual)
                iterations.append(found.iterations)
            rows.append(
                {
                    "body": body,
                    "indentation_m": depth,
                    "contacts": len(gaps),
                    "solves_a_cpu_s": len(seconds) / float(np.sum(seconds)),
                    "median_ms": 1e3 * float(np.median(seconds)),
                    "worst_relative_residual": float(np.max(residuals)),
                    "median_iterations": float(np.median(iterations)),
                }
            )
    start = time.process_time()
    press(patches, sensor, points[:6], Press(depth_m=0.0005, contact="elastic"))
    whole = 6 / (time.process_time() - start)
    return {"object": name, "cells": list(CELLS), "solves": rows, "elastic_touches_a_cpu_s": whole}
