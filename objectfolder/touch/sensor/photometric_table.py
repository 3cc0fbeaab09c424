"""Appearance of a painted membrane by table: from its slope and its place to red, green and blue.

The photometric model of retrographic sensors (Yuan, Dong & Adelson 2017, Sensors 17(12); Si & Yuan 2022,
"Taxim", RA-L 7(2)): for each slope of the membrane and each direction of it, a quadratic polynomial of the
place in the image. Here the table is interpolated between its nodes, so that it may be small.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from objectfolder.touch.sensor.half_float_table import HalfFloatTable

POLYNOMIAL_TERMS = 6
CHANNELS = 3


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
class PhotometricTable(HalfFloatTable):
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

    NAME: ClassVar[str] = "photometric table"
    LAYOUT: ClassVar[str] = (
        f"({CHANNELS} channels, at least 2 slopes, at least 3 directions, {POLYNOMIAL_TERMS} terms)"
    )

    @classmethod
    def fits(cls, shape: tuple[int, ...]) -> bool:
        """Whether coefficients may have this shape."""
        ends = (shape[0], shape[-1]) == (CHANNELS, POLYNOMIAL_TERMS) if shape else False
        return len(shape) == 4 and ends and shape[1] >= 2 and shape[2] >= 3

    def __post_init__(self) -> None:
        super().__post_init__()
        flat = self.coefficients[:, 0]
        if not (flat == flat[:, :1]).all():
            raise ValueError(f"{self.NAME} that depends on the direction at slope 0")

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
