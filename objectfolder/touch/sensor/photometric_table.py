"""Appearance of a painted membrane by table: from its slope and its place to red, green and blue.

The photometric model of retrographic sensors (Yuan, Dong & Adelson 2017, Sensors 17(12); Si & Yuan 2022,
"Taxim", RA-L 7(2)): for each slope of the membrane and each direction of it, a quadratic polynomial of the
place in the image. Here the table is interpolated between its nodes, so that it may be small.
"""

import base64
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import FormatError, InputError

POLYNOMIAL_TERMS = 6
CHANNELS = 3
LAYOUT = f"({CHANNELS} channels, at least 2 slopes, at least 3 directions, {POLYNOMIAL_TERMS} terms)"


def place_terms(across: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Terms (n, 6) of the polynomials: 1, a, b, a^2, a b, b^2, of the place a to the right and b up.

    Places are in halves of the gel's width and height from its centre: -1 to 1.
    """
    return np.stack([np.ones_like(across), across, up, across**2, across * up, up**2], axis=-1)


def node_weights(
    slope: np.ndarray, direction: np.ndarray, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes between which a table of `shape` (slopes, directions) is interpolated, and their weights.

    Parameters
    ----------
    slope, direction
        (n,) radians; slopes beyond 90 degrees count as 90.

    Returns
    -------
    tuple
        Nodes (4, n), slope x directions + direction, and weights (4, n) float32 whose sums are 1.
    """
    slopes, directions = shape
    row = np.clip(slope * ((slopes - 1) / (np.pi / 2)), 0, slopes - 1)
    lower = np.minimum(row.astype(np.int64), slopes - 2)
    column = (direction * (directions / (2 * np.pi))) % directions
    left = np.floor(column).astype(np.int64) % directions
    right = (left + 1) % directions
    down, along = row - lower, column - np.floor(column)
    nodes = np.stack([lower * directions + left, lower * directions + right])
    weights = np.stack([(1 - down) * (1 - along), (1 - down) * along, down * (1 - along), down * along])
    return np.concatenate([nodes, nodes + directions]), weights.astype(np.float32)


@dataclass(frozen=True, eq=False)
class PhotometricTable:
    """Coefficients of the polynomials, at slopes and directions.

    Parameters
    ----------
    coefficients
        (3, slopes, directions, 6) float16: of red, green and blue, 0..1, for the terms of `place_terms`.
        Slopes are angles of the membrane from the undeformed flat gel, evenly from 0 to 90 degrees, both
        included. Directions are where its normal (towards the camera) leans, evenly from 0 to 360 degrees,
        the last excluded, counted from the image's right towards its top. At slope 0 there is no direction:
        the coefficients there are equal.

    Raises
    ------
    ValueError
        Another shape or type, values that are not finite, or that depend on the direction at slope 0.
    """

    coefficients: np.ndarray

    def __post_init__(self) -> None:
        shape = self.coefficients.shape
        if (
            len(shape) != 4
            or shape[0] != CHANNELS
            or shape[1] < 2
            or shape[2] < 3
            or shape[3] != POLYNOMIAL_TERMS
        ):
            raise ValueError(f"a photometric table has shape {shape}, expected {LAYOUT}")
        if self.coefficients.dtype != np.float16:
            raise ValueError(f"a photometric table has type {self.coefficients.dtype}, expected float16")
        if not np.isfinite(self.coefficients).all():
            raise ValueError("a photometric table holds values that are not finite")
        flat = self.coefficients[:, 0]
        if not (flat == flat[:, :1]).all():
            raise ValueError("a photometric table depends on the direction at slope 0")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PhotometricTable) and self._bytes == other._bytes

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _bytes(self) -> tuple[tuple[int, ...], bytes]:
        return self.coefficients.shape, self.coefficients.tobytes()

    @cached_property
    def _hash(self) -> int:
        return hash(self._bytes)

    @cached_property
    def nodes(self) -> np.ndarray:
        """Coefficients (slopes * directions, 18) float32, channels before terms, a node a row."""
        _, slopes, directions, _ = self.coefficients.shape
        moved = np.moveaxis(self.coefficients, 0, 2).reshape(slopes * directions, CHANNELS * POLYNOMIAL_TERMS)
        return np.ascontiguousarray(moved, dtype=np.float32)

    def values(
        self, slope: np.ndarray, direction: np.ndarray, across: np.ndarray, up: np.ndarray
    ) -> np.ndarray:
        """Pixel values (n, 3) float32, 0..1, of the membrane.

        Parameters
        ----------
        slope, direction
            (n,) radians, as the class describes them; slopes beyond 90 degrees count as 90.
        across, up
            (n,) place, as in `place_terms`.
        """
        _, slopes, directions, _ = self.coefficients.shape
        mixed = np.zeros((len(slope), CHANNELS * POLYNOMIAL_TERMS), dtype=np.float32)
        for node, weight in zip(*node_weights(slope, direction, (slopes, directions)), strict=True):
            mixed += weight[:, None] * self.nodes[node]
        terms = place_terms(across.astype(np.float32), up.astype(np.float32))
        values = np.einsum("nct,nt->nc", mixed.reshape(-1, CHANNELS, POLYNOMIAL_TERMS), terms)
        return np.asarray(np.clip(values, 0, 1, dtype=np.float32))

    def to_dict(self) -> dict[str, Any]:
        """Return the table as JSON: shape, and little-endian half floats in base 64."""
        packed = base64.b64encode(self.coefficients.astype("<f2").tobytes()).decode("ascii")
        return {"shape": list(self.coefficients.shape), "float16": packed}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "PhotometricTable":
        """Return the table that `to_dict` described.

        Raises
        ------
        FormatError
            Anything else.
        """
        try:
            data = np.frombuffer(base64.b64decode(values["float16"], validate=True), dtype="<f2")
            return cls(data.reshape(values["shape"]).astype(np.float16))
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError("photometric table", f"not as it was written ({error})") from error

    @classmethod
    def read(cls, path: Path) -> "PhotometricTable":
        """Read a table of any floating type from an .npy file.

        Raises
        ------
        InputError
            A file that is not there, or no table.
        """
        remedy = f"Write an array {LAYOUT} with numpy.save; see PhotometricTable."
        try:
            stored = np.load(path, allow_pickle=False)
            if not np.issubdtype(stored.dtype, np.floating):
                raise ValueError(f"its type is {stored.dtype}")
            with np.errstate(over="ignore"):
                return cls(stored.astype(np.float16))
        except (OSError, ValueError) as error:
            raise InputError(str(path), f"no photometric table ({error})", remedy) from error
