"""A surface in few bytes: quantised positions, predicted; connectivity by first appearance.

Faces are walked from neighbour to neighbour. A corner is coded by how long ago its vertex appeared (0:
never), so connectivity decodes as one cumulative sum; a new vertex is coded as its offset from the
parallelogram of the face it was reached from (Touma and Gotsman 1998). LZMA takes what regularity
is left.
"""

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.products.integer_coding import pack_integers, unpack_integers, unzigzag, zigzag
from objectfolder.surface.surface import Surface

QUANTISATION_STEP_M = 1e-6
STEPS_ALONG_LONGEST_SIDE = 1 << 14
LARGEST_COUNT = 1 << 22  # of vertices or faces; a larger number in a file is no reason to set memory aside
LARGEST_COORDINATE_M = 1e6


def quantisation_step(surface: Surface) -> float:
    """Grid step, metres: 1 micrometre (as scans are written), or finer: 2^14 steps along the longest side."""
    return min(QUANTISATION_STEP_M, float(np.ptp(surface.bounds, axis=0).max()) / STEPS_ALONG_LONGEST_SIDE)


def encode_surface(surface: Surface, step: float | None = None) -> dict[str, np.ndarray]:
    """Encode a surface with every vertex moved by at most half a grid step along each axis.

    Parameters
    ----------
    surface
        What to encode; vertices that no face uses are left out.
    step
        Grid step, metres; `quantisation_step` by default.

    Returns
    -------
    dict
        ``surface.origin`` (3,) and ``surface.step`` (1,) float64 metres, ``surface.counts`` (2,) int64
        vertices and faces, ``surface.connectivity`` and ``surface.positions`` uint8 streams.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> decoded = decode_surface(encode_surface(Surface(corners, np.array([[0, 1, 2]]))))
    >>> float(abs(decoded.vertices - corners).max()) < 1e-6
    True
    """
    if step is None:
        step = quantisation_step(surface)
    origin = surface.bounds[0]
    grid = np.rint((surface.vertices - origin) / step).astype(np.int64)
    order, rotation = _walk(surface.faces)
    faces = np.take_along_axis(surface.faces[order], (rotation[:, None] + np.arange(3)) % 3, axis=1)
    corners = faces.ravel()
    used, first = np.unique(corners, return_index=True)
    sequence = used[np.argsort(first)]
    number = np.full(len(surface.vertices), -1, dtype=np.int64)
    number[sequence] = np.arange(len(sequence))
    corners = number[corners]
    is_new = np.zeros(len(corners), dtype=bool)
    is_new[first] = True
    age = np.where(is_new, 0, np.cumsum(is_new) - corners)
    positions = grid[sequence]
    offsets = positions - _predictions(corners, is_new, positions)
    return {
        "surface.origin": origin.astype(np.float64),
        "surface.step": np.array([step]),
        "surface.counts": np.array([len(sequence), len(faces)], dtype=np.int64),
        "surface.connectivity": pack_integers(age.reshape(-1, 3).T.ravel()),
        "surface.positions": pack_integers(zigzag(offsets).T.ravel()),
    }


def decode_surface(tensors: dict[str, np.ndarray]) -> Surface:
    """Decode what `encode_surface` returned.

    Raises
    ------
    FormatError
        Streams that are damaged or do not fit together, more than `LARGEST_COUNT` vertices or faces, or
        coordinates beyond `LARGEST_COORDINATE_M`.
    """
    try:
        vertex_count, face_count = (int(value) for value in tensors["surface.counts"])
        if not (0 < vertex_count <= LARGEST_COUNT and 0 < face_count <= LARGEST_COUNT):
            raise ValueError(f"{vertex_count} vertices and {face_count} faces")
        age = unpack_integers(tensors["surface.connectivity"], 3 * face_count).reshape(3, -1).T.ravel()
        offsets = unzigzag(unpack_integers(tensors["surface.positions"], 3 * vertex_count).reshape(3, -1).T)
        is_new = age == 0
        corners = np.cumsum(is_new) - np.where(is_new, 1, age)
        if is_new.sum() != vertex_count or corners.min() < 0:
            raise ValueError("connectivity names vertices that are not there")
        positions = _integrate(corners, is_new, offsets)
        vertices = tensors["surface.origin"] + positions * float(tensors["surface.step"][0])
        if not np.abs(vertices).max() <= LARGEST_COORDINATE_M:
            raise ValueError(f"a coordinate that is not within {LARGEST_COORDINATE_M:g} m")
        return Surface(vertices, corners.reshape(-1, 3))
    except (ValueError, KeyError, IndexError) as error:
        raise FormatError("surface", f"damaged ({error})") from error


def _walk(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth-first order of the faces, and each face's rotation that puts the shared edge first.

    The corner opposite the edge through which a face was reached comes last.
    """
    across: dict[tuple[int, int], list[int]] = {}
    triples = faces.tolist()
    for index, (a, b, c) in enumerate(triples):
        for edge in ((a, b), (b, c), (c, a)):
            across.setdefault((min(edge), max(edge)), []).append(index)
    visited = bytearray(len(triples))
    order, rotations = [], []
    for seed in range(len(triples)):
        stack = [(seed, 0)]
        while stack:
            index, rotation = stack.pop()
            if visited[index]:
                continue
            visited[index] = 1
            order.append(index)
            rotations.append(rotation)
            face = triples[index]
            a, b, c = (face[(rotation + corner) % 3] for corner in range(3))
            for start, end in ((a, b), (c, a), (b, c)):
                for neighbour in across[min(start, end), max(start, end)]:
                    if not visited[neighbour]:
                        opposite = next(
                            (k for k, v in enumerate(triples[neighbour]) if v not in (start, end)), 2
                        )
                        stack.append((neighbour, (opposite + 1) % 3))
    return np.array(order), np.array(rotations)


def _references(corners: np.ndarray, is_new: np.ndarray) -> list[tuple[int, int, int]]:
    """For each vertex in order of appearance, (u, v, w) whose u + v - w predicts it; all -1 for the first.

    The parallelogram across the shared edge where that face is known, else the vertex before.
    """
    sequence = corners.tolist()
    fresh = is_new.tolist()
    opposite: dict[tuple[int, int], int] = {}
    references: list[tuple[int, int, int]] = []
    for start in range(0, len(sequence), 3):
        a, b, c = sequence[start : start + 3]
        for corner in range(3):
            if fresh[start + corner]:
                across = opposite.get((min(a, b), max(a, b))) if corner == 2 else None
                last = len(references) - 1
                references.append((last, last, last) if across is None else (a, b, across))
        opposite[min(a, b), max(a, b)] = c
        opposite[min(b, c), max(b, c)] = a
        opposite[min(c, a), max(c, a)] = b
    return references


def _predictions(corners: np.ndarray, is_new: np.ndarray, positions: np.ndarray) -> np.ndarray:
    references = np.array(_references(corners, is_new))
    predicted = positions[references[:, 0]] + positions[references[:, 1]] - positions[references[:, 2]]
    predicted[references[:, 0] < 0] = 0
    return predicted


def _integrate(corners: np.ndarray, is_new: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    xs: list[int] = []
    ys: list[int] = []
    zs: list[int] = []
    for (u, v, w), (x, y, z) in zip(_references(corners, is_new), offsets.tolist(), strict=True):
        if u < 0:
            xs.append(x)
            ys.append(y)
            zs.append(z)
        else:
            xs.append(xs[u] + xs[v] - xs[w] + x)
            ys.append(ys[u] + ys[v] - ys[w] + y)
            zs.append(zs[u] + zs[v] - zs[w] + z)
    return np.stack([xs, ys, zs], axis=1)
