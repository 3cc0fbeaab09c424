"""A surface in few bytes: quantised positions, predicted; connectivity by first appearance.

Faces are walked from neighbour to neighbour. A corner is coded by how long ago its vertex appeared (0:
never), so connectivity decodes as one cumulative sum; a new vertex is coded as its offset from the
parallelogram of the face it was reached from (Touma and Gotsman 1998). LZMA takes what regularity
is left.

Normals of the source follow: only those that the rule of creases misses, as offsets from it. They become
points of a square, by the octahedron (Meyer et al. 2010, "On floating-point normal vectors", Eurographics
Symposium on Rendering). Corners at a vertex that share a normal name it once.
"""

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import FormatError
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


QUANTISATION_STEP_M = 1e-6
STEPS_ALONG_LONGEST_SIDE = 1 << 14
LARGEST_COUNT = 1 << 18  # of vertices or faces: six times those of the largest of a hundred scans
MOST_MEETINGS = 1 << 24  # pairs of corners in one place, which smooth normals need: a fan of 4,096 faces
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
        vertices and faces, ``surface.connectivity`` and ``surface.positions`` uint8 streams; and what
        `encode_normals` returns, where the source has normals of its own.

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
    order, turned = stored_order(surface.faces)
    faces = np.take_along_axis(surface.faces[order], turned, axis=1)
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
    normals = None
    if surface.normals is not None:
        normals = np.take_along_axis(surface.normals[order], turned[..., None], axis=1)
    decoded = Surface(origin + positions * step, corners.reshape(-1, 3), normals=normals)
    return {
        "surface.origin": origin.astype(np.float64),
        "surface.step": np.array([step]),
        "surface.counts": np.array([len(sequence), len(faces)], dtype=np.int64),
        "surface.connectivity": pack_integers(age.reshape(-1, 3).T.ravel()),
        "surface.positions": pack_integers(zigzag(offsets).T.ravel()),
        **encode_normals(decoded),
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
        if problem := too_large(vertices, corners):
            raise ValueError(problem)
        surface = Surface(vertices, corners.reshape(-1, 3))
        surface.normals = decoded_normals(tensors, surface)
        return surface
    except (ValueError, KeyError, IndexError) as error:
        raise FormatError("surface", f"damaged ({error})") from error


def too_large(vertices: np.ndarray, faces: np.ndarray) -> str:
    """Say why an Object File does not hold a surface; nothing if it does.

    Parameters
    ----------
    vertices, faces
        (n, 3) metres, and any shape of indices.

    Examples
    --------
    >>> too_large(np.zeros((3, 3)), np.zeros((5000, 3), np.int64))
    'up to 15000 corners of faces in one place'
    """
    if max(len(vertices), faces.size // 3) > LARGEST_COUNT:
        return f"{len(vertices)} vertices and {faces.size // 3} faces, more than {LARGEST_COUNT} of each"
    # Vertices in one place share this number, and hardly any others do.
    number = vertices[:, 0] * np.sqrt(2) + vertices[:, 1] * np.sqrt(3) + vertices[:, 2] * np.sqrt(5)
    meeting = np.bincount(np.unique(number, return_inverse=True)[1][faces.ravel()])
    return (
        f"up to {meeting.max()} corners of faces in one place" if (meeting**2).sum() > MOST_MEETINGS else ""
    )


def stored_order(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which of (F, 3) faces each decoded one is (F,), and which of its corners are its own (F, 3)."""
    order, rotation = _walk(faces)
    return order, (rotation[:, None] + np.arange(3)) % 3


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


def _references(corners: np.ndarray, is_new: np.ndarray) -> np.ndarray:
    """For each vertex in order of appearance, (u, v, w) whose u + v - w predicts it; all -1 for the first.

    The parallelogram across the shared edge where that face is known, else the vertex before.
    """
    faces = corners.reshape(-1, 3)
    first, second, opposite = faces.ravel(), faces[:, [1, 2, 0]].ravel(), faces[:, [2, 0, 1]].ravel()
    edge = np.minimum(first, second) << 32 | np.maximum(first, second)
    # Equal edges in the order of their faces: the one before is the last that was known.
    order = np.argsort(edge, kind="stable")
    again = np.flatnonzero(edge[order[1:]] == edge[order[:-1]])
    across = np.full(len(edge), -1)
    across[order[again + 1]] = opposite[order[again]]
    new = np.flatnonzero(is_new)
    before = np.arange(len(new)) - 1
    references = np.stack([before, before, before], axis=1)
    edges = new - 2  # of a face's third corner: its first edge
    predictable = np.flatnonzero((new % 3 == 2) & (across[edges] >= 0))
    references[predictable] = np.stack([first, second, across], axis=1)[edges[predictable]]
    return references


def _predictions(corners: np.ndarray, is_new: np.ndarray, positions: np.ndarray) -> np.ndarray:
    references = _references(corners, is_new)
    predicted = positions[references[:, 0]] + positions[references[:, 1]] - positions[references[:, 2]]
    predicted[references[:, 0] < 0] = 0
    return predicted


def _integrate(corners: np.ndarray, is_new: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Positions (n, 3) of vertices, each its prediction from those before and its offset."""
    u, v, w = (column.tolist() for column in _references(corners, is_new).T)
    axes = []
    for steps in offsets.T:
        places = steps.tolist()
        for index in range(1, len(places)):
            places[index] += places[u[index]] + places[v[index]] - places[w[index]]
        axes.append(places)
    return np.array(axes).T
