"""Values of queries, checked before anything is computed: an error names the argument as its caller does."""

import math
import operator
import reprlib
from typing import Any

import numpy as np

from objectfolder.errors import QueryError

MOST_BYTES = 1 << 30  # of one argument, and of one answer
MOST_PIXELS = 1 << 24  # of a side
MOST_SAMPLED = 1 << 22  # views or contacts drawn at once
LARGEST_SEED = 2**63 - 1


def real_array(name: str, values: Any, remedy: str = "Give an array of numbers.") -> np.ndarray:
    """Return finite real values as float64.

    Parameters
    ----------
    name
        What the caller calls them.

    Raises
    ------
    QueryError
        Something else, or more than `MOST_BYTES`.

    Examples
    --------
    >>> real_array("points", [[0, 1, float("nan")]])
    Traceback (most recent call last):
    objectfolder.errors.QueryError: points: not finite. Give numbers.
    """
    if isinstance(values, np.ndarray):
        require_room(name, 8 * values.size, "Ask for less at a time.")
    try:
        array = np.asarray(values)
        if np.iscomplexobj(array):
            raise TypeError("complex")
        numbers = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise QueryError(name, reprlib.repr(values), remedy) from error
    if not np.isfinite(numbers).all():
        raise QueryError(name, "not finite", "Give numbers.")
    return numbers


def point_rows(values: Any, name: str, least: int = 0) -> np.ndarray:
    """Return (3,) or (n, 3) finite values as (n, 3) float64.

    Parameters
    ----------
    name
        What the caller calls them.
    least
        How many there must be.

    Raises
    ------
    QueryError
        Fewer, another shape, values that are not finite, or more than `MOST_BYTES`.

    Examples
    --------
    >>> point_rows([0, 0, 1], "points").shape
    (1, 3)
    """
    rows = real_array(name, values, "Give an array (n, 3) of numbers.")
    if rows.ndim == 1:
        rows = rows[None]
    if rows.ndim != 2 or rows.shape[1] != 3 or len(rows) < least:
        raise QueryError(
            name, f"shape {np.shape(values)}", "Give (n, 3)." if rows.size else "Give one at least."
        )
    return rows


def real(name: str, value: Any, low: float = -math.inf, high: float = math.inf, unit: str = "") -> float:
    """Return one finite number within `low` to `high`.

    Raises
    ------
    QueryError
        Anything else.

    Examples
    --------
    >>> real("duration", -1, 0.0, 10.0, " s")
    Traceback (most recent call last):
    objectfolder.errors.QueryError: duration: -1.0 s. Give 0 s to 10 s.
    """
    if isinstance(value, bool | str) or np.ndim(value) or np.iscomplexobj(value):
        raise QueryError(name, reprlib.repr(value), "Give a number.")
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise QueryError(name, reprlib.repr(value), "Give a number.") from error
    if not (math.isfinite(number) and low <= number <= high):
        raise QueryError(name, f"{number}{unit}", f"Give {low:g}{unit} to {high:g}{unit}.")
    return number


def whole(name: str, value: Any, low: int, high: int) -> int:
    """Return one whole number within `low` to `high`.

    Raises
    ------
    QueryError
        Anything else.

    Examples
    --------
    >>> whole("count", 1.5, 0, 10)
    Traceback (most recent call last):
    objectfolder.errors.QueryError: count: 1.5. Give a whole number, 0 to 10.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = low - 1
    if isinstance(value, bool) or not low <= number <= high:
        raise QueryError(name, reprlib.repr(value), f"Give a whole number, {low} to {high}.")
    return number


def image_sides(resolution: Any, least: int) -> tuple[int, int]:
    """Return height and width in pixels, of one number or two.

    Raises
    ------
    QueryError
        Anything else, or fewer than `least`.

    Examples
    --------
    >>> image_sides(64, 1), image_sides((3, 4), 1)
    ((64, 64), (3, 4))
    """
    sides = tuple(resolution) if np.iterable(resolution) else (resolution, resolution)
    if len(sides) != 2:
        remedy = "Give whole pixels of a side, or (height, width)."
        raise QueryError("resolution", reprlib.repr(resolution), remedy)
    height, width = (whole("resolution", side, least, MOST_PIXELS) for side in sides)
    return height, width


def generator(seed: Any) -> np.random.Generator:
    """Return the random generator of a seed, 0 or more.

    Raises
    ------
    QueryError
        Anything else: also None, whose numbers would differ from time to time.
    """
    return np.random.default_rng(whole("seed", seed, 0, LARGEST_SEED))


def require_room(name: str, size: float, remedy: str) -> None:
    """Refuse arguments and answers of more than `MOST_BYTES`.

    Parameters
    ----------
    size
        Bytes.

    Raises
    ------
    QueryError
        More.
    """
    if size > MOST_BYTES:
        finding = f"{size / 1e9:.4g} GB, more than {MOST_BYTES / 1e9:.4g} at once"
        raise QueryError(name, finding, remedy)
