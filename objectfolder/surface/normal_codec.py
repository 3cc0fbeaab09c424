"""Normals of a source in few bytes: only those that the rule of creases misses, as offsets from it.

Normals become points of a square, by the octahedron (Meyer et al. 2010, "On floating-point normal vectors",
Eurographics Symposium on Rendering). Corners at a vertex that share a normal name it once.
"""

import numpy as np
from numpy.typing import NDArray

from objectfolder.products.integer_coding import pack_integers, unpack_integers, unzigzag, zigzag
from objectfolder.surface.surface import Surface, corner_normals

NORMAL_STEPS = 256
"""From the middle of the square to its side: normals are off by .2 degrees in the mean."""

NEAR_DEG = 0.5
"""Normals of a source this near to the rule's are left to the rule."""

RANKS, OFFSETS = "surface.normal_ranks", "surface.normals"

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def encode_normals(surface: Surface) -> dict[str, np.ndarray]:
    """Encode normals of a source against those that the rule gives on the same, decoded surface.

    Parameters
    ----------
    surface
        As `decode_surface` gives it, with the source's normals.

    Returns
    -------
    dict
        ``surface.normal_ranks``, of each corner which of its vertex' normals is its own, and
        ``surface.normals``, offsets of these; empty where the rule gives all.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> leaning = np.tile([0.0, 0.6, 0.8], (1, 3, 1))
    >>> triangle = Surface(corners, np.array([[0, 1, 2]]), normals=leaning)
    >>> decoded_normals(encode_normals(triangle), triangle)[0, 0].round(2).tolist()
    [0.0, 0.6, 0.8]
    """
    rule = corner_normals(surface.vertices, surface.faces).reshape(-1, 3)
    source = surface.corner_normals.reshape(-1, 3)
    far = np.einsum("ij,ij->i", rule, source) < np.cos(np.radians(NEAR_DEG))
    if surface.normals is None or not far.any():
        return {}
    vertex, codes = surface.faces.ravel(), _codes(source)
    side = 2 * NORMAL_STEPS + 2
    key = np.where(far, (codes[:, 0] + NORMAL_STEPS) * side + codes[:, 1] + NORMAL_STEPS, -1)
    either = vertex * side * side + key + 1
    _, first, pair = np.unique(either, return_index=True, return_inverse=True)
    order = np.lexsort([first, vertex[first]])
    starts = np.searchsorted(vertex[first][order], np.arange(len(surface.vertices)))
    rank = np.empty(len(first), dtype=np.int64)
    rank[order] = np.arange(len(first)) - starts[vertex[first][order]]
    corner = first[order]
    offsets = np.where(far[corner, None], codes[corner] - _codes(rule[corner]), 0)
    return {RANKS: pack_integers(rank[pair]), OFFSETS: pack_integers(zigzag(offsets).T.ravel())}


def decoded_normals(tensors: dict[str, np.ndarray], surface: Surface) -> Floats | None:
    """Decode what `encode_normals` returned: (F, 3, 3), zero where the rule holds; None for no normals.

    Raises
    ------
    ValueError
        Streams that are damaged or do not fit the surface.
    """
    if RANKS not in tensors:
        return None
    vertex = surface.faces.ravel()
    rank = unpack_integers(tensors[RANKS], len(vertex))
    if not 0 <= rank.min() <= rank.max() < len(vertex):
        raise ValueError("a corner names a normal that is not there")
    _, first, pair = np.unique(vertex * len(vertex) + rank, return_index=True, return_inverse=True)
    offsets = unzigzag(unpack_integers(tensors[OFFSETS], 2 * len(first)).reshape(2, -1).T)
    codes = _codes(corner_normals(surface.vertices, surface.faces).reshape(-1, 3)[first]) + offsets
    normals = np.where(
        offsets.any(axis=1)[:, None], _directions(np.clip(codes, -NORMAL_STEPS, NORMAL_STEPS)), 0.0
    )
    return np.asarray(normals[pair.reshape(-1)].reshape(-1, 3, 3))


def _codes(normals: Floats) -> Integers:
    """Places (n, 2) on the square of the octahedron, -`NORMAL_STEPS` to `NORMAL_STEPS`."""
    flat = normals / np.maximum(np.abs(normals).sum(axis=1, keepdims=True), 1e-300)
    return np.rint(NORMAL_STEPS * np.where(flat[:, 2:] < 0, _folded(flat[:, :2]), flat[:, :2])).astype(
        np.int64
    )


def _directions(codes: Integers) -> Floats:
    """Unit normals (n, 3) at places on the square."""
    square = codes / NORMAL_STEPS
    up = 1 - np.abs(square).sum(axis=1, keepdims=True)
    direction = np.concatenate([np.where(up < 0, _folded(square), square), up], axis=1)
    return np.asarray(direction / np.linalg.norm(direction, axis=1, keepdims=True))


def _folded(square: Floats) -> Floats:
    return np.asarray((1 - np.abs(square[:, ::-1])) * np.where(square < 0, -1.0, 1.0))
