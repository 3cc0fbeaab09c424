"""Points and vectors as a query gives them: one or many."""

import reprlib

import numpy as np

from objectfolder.errors import QueryError


def point_rows(values: np.ndarray, name: str) -> np.ndarray:
    """Return (3,) or (n, 3) finite values as (n, 3) float64.

    Parameters
    ----------
    name
        What an error calls them.

    Raises
    ------
    QueryError
        Another shape, or values that are not finite.
    """
    try:
        rows = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise QueryError(name, reprlib.repr(values), "Give an array (n, 3) of numbers.") from error
    if rows.ndim == 1:
        rows = rows[None]
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise QueryError(name, f"shape {np.shape(values)}", "Give (n, 3).")
    if not np.isfinite(rows).all():
        raise QueryError(name, "not finite", "Give numbers.")
    return rows
