"""Colours of vertices and faces as files write them: as fractions or levels, with opacities or without."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.material_library import DEFAULT_COLOUR

_ROUNDING = 1.001
"""A colour of 1 that was computed is not above it."""


def alpha_remark(alphas: Iterable[Any]) -> list[str]:
    """Return a sentence where opacities of colours, as bytes or fractions, show; nothing where none do."""
    for alpha in map(np.asarray, alphas):
        opaque_value = (
            np.iinfo(alpha.dtype).max if alpha.dtype.itemsize == 1 else max(alpha.max(initial=0), 1)
        )
        if alpha.size and float(alpha.min()) < 0.99 * float(opaque_value):
            return ["the alpha of its colours is not used: it is drawn opaque"]
    return []


def colour_fractions(path: Path, values: np.ndarray) -> np.ndarray:
    """Return colours (n, 3) of any type in 0..1; `InputError` for what is no colour."""
    if values.dtype == np.int8:
        values = values.view(np.uint8)
    largest = float(np.nanmax(values, initial=0))
    whole = values.dtype.kind in "iu"
    if whole and (values.dtype.itemsize == 1 or largest > 1):
        ranges = (255, 65535, np.iinfo(values.dtype).max)
        most = float(next(most for most in ranges if largest <= most))
    else:
        most = 1.0 if largest <= _ROUNDING else 255.0
    if largest > _ROUNDING * most or float(np.nanmin(values, initial=0)) < 0:
        finding = f"has colours from {np.nanmin(values):g} to {largest:g}"
        raise InputError(str(path), finding, "Write them as bytes in 0..255")
    return np.clip(np.nan_to_num(values.astype(np.float64) / most), 0, 1)


def colour_rows(rows: list[list[float]], remarks: list[str]) -> list[list[float]]:
    """Red, green and blue behind x, y and z of each vertex, or nothing.

    The format has a weight w there, which is of curves alone; programs write colours, some with a weight
    before or an opacity behind them.
    """
    weights = [row[3] for row in rows if len(row) in (4, 7)]
    before_colour = any(len(row) == 7 for row in rows) and set(weights) == {1.0}
    if any(len(row) == 4 for row in rows) and set(weights) != {1.0}:
        remarks.append("its vertices have weights (w) other than 1, which are left out: x y z are positions")
    if any(len(row) == 7 for row in rows):
        order = "w r g b" if before_colour else "r g b a"
        remarks.append(f"its vertices have seven numbers, which are read as x y z {order}")
    if any(len(row) == 5 or len(row) > 7 for row in rows):
        remarks.append("its vertices have more numbers than a position and a colour, which are left out")
    return [row[4:7] if len(row) == 7 and before_colour else row[3:6] if len(row) > 5 else [] for row in rows]


def all_white(rows: list[list[float]]) -> bool:
    """Whether colours say nothing: programs that have none write white."""
    colours = np.array([row for row in rows if row])
    return bool((colours == 1).all() or (colours == 255).all())


def vertex_colours_of(path: Path, rows: list[list[float]], remarks: list[str]) -> np.ndarray:
    """(V, 3) in 0..1 of rows of three numbers; the default colour where a vertex has none."""
    coloured = np.array([bool(row) for row in rows])
    written = np.array([row for row in rows if row])
    if not (np.isfinite(written).all() and written.min() >= 0 and written.max() <= 255):
        raise InputError(str(path), "has vertex colours outside of 0..1 and 0..255", "Export the mesh again")
    colours = np.tile(DEFAULT_COLOUR, (len(rows), 1))
    colours[coloured] = written / 255 if written.max() > 1 else written
    if not coloured.all():
        bare = np.count_nonzero(~coloured)
        remarks.append(f"{bare} of {len(rows)} vertices have no colour and are drawn grey")
    return colours
