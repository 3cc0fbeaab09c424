"""An indentation response fitted to photographs of a ball, by linear least squares. Needs SciPy."""

from collections.abc import Mapping, Sequence

import numpy as np

from objectfolder.touch.sensor.indentation_response import CHANNELS, TERMS, Cells, IndentationResponse

# Half a pattern's side, cells.
RESPONSE_REACH = 8
# Of the weight of a pattern's roughness: that of its size.
RIDGE = 0.1
# Of a cell: less of it beyond the contact says nothing.
LEAST_BEYOND = 0.5


class ResponseFit:
    """Responses of some photographs of a ball.

    Parameters
    ----------
    changes
        Of each, (height, width, 3): the photograph less what the sensor shows untouched, grey levels.
    indentations_m
        Of each, (height, width): how far the ball presses the gel in.
    """

    def __init__(self, changes: Mapping[int, np.ndarray], indentations_m: Mapping[int, np.ndarray]) -> None:
        height, width = next(iter(changes.values())).shape[:2]
        self._cells = Cells.of(height, width)
        self._sums = {index: self._sum(changes[index], indentations_m[index]) for index in changes}

    def solve(self, chosen: Sequence[int], roughness: float, unevenness: float) -> IndentationResponse:
        """Return the response that explains best what changes beyond the contacts of those chosen.

        `roughness` is the weight of a pattern's squared second differences; its dependence on the place
        costs `unevenness` times as much.
        """
        from scipy.linalg import solve

        matrix, right = (np.sum([self._sums[index][part] for index in chosen], axis=0) for part in (0, 1))
        held = roughness * np.trace(matrix) / len(matrix) * _roughness(unevenness)
        unknowns = solve(matrix + held, right, assume_a="pos")
        side = 2 * RESPONSE_REACH + 1
        return IndentationResponse(unknowns.T.reshape(CHANNELS, TERMS, side, side).astype(np.float16))

    def _sum(self, change: np.ndarray, indentation_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations (k, k) and (k, 3) of the cells beyond a contact."""
        beyond = (indentation_m == 0).astype(np.float32)
        share = self._cells.mean(beyond)
        kept = share > LEAST_BEYOND
        means = self._cells.mean(change * beyond[..., None])[kept] / share[kept][:, None]
        sources = self._sources(indentation_m)[kept.ravel()].astype(np.float64)
        return sources.T @ sources, sources.T @ (means / 255)

    def _sources(self, indentation_m: np.ndarray) -> np.ndarray:
        """What cells take (cells, k) of the coefficients of a response."""
        weighted = 1e3 * self._cells.mean(indentation_m.astype(np.float32)) * self._cells.terms()
        padded = np.pad(
            weighted, ((0, 0), (RESPONSE_REACH, RESPONSE_REACH), (RESPONSE_REACH, RESPONSE_REACH))
        )
        side = 2 * RESPONSE_REACH + 1
        windows = np.lib.stride_tricks.sliding_window_view(padded, (TERMS, side, side))[0]
        return np.flip(windows, (-2, -1)).reshape(-1, TERMS * side * side)


def _roughness(unevenness: float) -> np.ndarray:
    """Squared second differences of patterns, and a little of their squares (unknowns, unknowns)."""
    side = 2 * RESPONSE_REACH + 1
    bend = np.eye(side, k=1) - 2 * np.eye(side) + np.eye(side, k=-1)
    laplacian = np.kron(bend, np.eye(side)) + np.kron(np.eye(side), bend)
    once = laplacian.T @ laplacian + RIDGE * np.eye(side * side)
    return np.kron(np.diag([1.0, unevenness, unevenness]), once)
