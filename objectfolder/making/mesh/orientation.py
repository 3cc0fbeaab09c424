"""Which faces of a welded surface to reverse, so that it is wound consistently and outwards."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from objectfolder.surface.connectivity import EdgeTable, edge_table
from objectfolder.surface.winding_number import solid_angles

_PROBES = 9
"""Vertices of a patch tested for lying within another."""


@dataclass(frozen=True)
class Orientation:
    """Which faces to reverse, and what was found.

    Parameters
    ----------
    reverse
        (F,) bool.
    cavities
        Closed patches that stay inside out because they lie in a solid.
    nested_solids
        Closed patches within another that are wound like it: solid in solid, which counts once.
    unorientable_patches
        Patches with no consistent winding (Moebius); left as they were.
    """

    reverse: np.ndarray
    cavities: int
    nested_solids: int
    unorientable_patches: int


@dataclass(frozen=True)
class _Patch:
    """Faces connected through edges of exactly two faces, wound alike."""

    faces: np.ndarray
    volume: float
    closed: bool


def outward_orientation(vertices: np.ndarray, faces: np.ndarray) -> Orientation:
    """Find the faces to reverse so that the surface is wound consistently and outwards.

    Winding is propagated over edges of exactly two faces, the majority of each such patch kept. A closed
    patch that lies in no other encloses positive volume; one that lies in another keeps the winding that the
    file gives it relative to the one around it, so that cavities stay cavities. Open patches keep theirs too,
    all reversed together where their volume, capped over the boundaries, is negative in sum.

    Parameters
    ----------
    vertices, faces
        (V, 3) metres and (F, 3), welded.
    """
    edges = edge_table(faces)
    label, reverse, unorientable = consistent_patches(len(faces), edges)
    wound = np.where(reverse[:, None], faces[:, ::-1], faces)
    patches = [_patch(vertices, wound, members) for members in _members(label)]
    closed = [patch for patch in patches if patch.closed]
    opened = [patch for patch in patches if not patch.closed]
    if sum(patch.volume for patch in opened) < 0:
        for patch in opened:
            reverse[patch.faces] ^= True
    signs, depths = _closed_signs(vertices, wound, closed)
    for patch, sign in zip(closed, signs, strict=True):
        if sign * patch.volume < 0:
            reverse[patch.faces] ^= True
    return Orientation(
        reverse,
        cavities=int(np.count_nonzero(signs < 0)),
        nested_solids=int(np.count_nonzero((signs > 0) & (depths > 0))),
        unorientable_patches=unorientable,
    )


def consistent_patches(count: int, edges: EdgeTable) -> tuple[np.ndarray, np.ndarray, int]:
    """Patch (F,) of each face, whether to reverse it (F,), and the number of unorientable patches.

    Works on the double cover: each face appears as it is and reversed, neighbours connect where they agree.
    An orientable patch falls apart into two mirrored components there; an unorientable one does not.
    """
    first, second = edges.manifold_pairs()
    agree = edges.forward[first] != edges.forward[second]
    left, right = first // 3, second // 3
    rows = np.concatenate([left, left + count])
    columns = np.concatenate([right + np.where(agree, 0, count), right + np.where(agree, count, 0)])
    cover = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(2 * count, 2 * count))
    _, component = connected_components(cover, directed=False)
    as_is, reversed_ = component[:count], component[count:]
    label = np.minimum(as_is, reversed_)
    twisted = as_is == reversed_
    reverse = ~twisted & (as_is != label)
    size = np.bincount(label, minlength=component.max() + 1)
    mostly_reversed = 2 * np.bincount(label, weights=reverse, minlength=len(size)) > size
    reverse ^= mostly_reversed[label] & ~twisted
    return label, reverse, len(np.unique(label[twisted]))


def _members(label: np.ndarray) -> list[np.ndarray]:
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def _patch(vertices: np.ndarray, faces: np.ndarray, members: np.ndarray) -> _Patch:
    """Volume of a patch, its boundary closed by a fan from the middle of it."""
    table = edge_table(faces[members])
    imbalance = table.imbalance
    rim = np.flatnonzero(imbalance)
    triangles = vertices[faces[members]]
    origin = triangles.mean(axis=(0, 1))
    if len(rim):
        ends = vertices[table.vertices[rim]]
        apex = np.broadcast_to(ends.mean(axis=(0, 1)), (len(rim), 3))
        cap = np.stack([ends[:, 1], ends[:, 0], apex], axis=1)
        weights = np.concatenate([np.ones(len(triangles)), imbalance[rim]])
        triangles = np.concatenate([triangles, cap])
    else:
        weights = np.ones(len(triangles))
    return _Patch(members, float(weights @ _tetrahedron_volumes(triangles - origin)), len(rim) == 0)


def _tetrahedron_volumes(triangles: np.ndarray) -> np.ndarray:
    """Signed volumes (n,) of the tetrahedra from the origin to (n, 3, 3) triangles."""
    return np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6


def _closed_signs(
    vertices: np.ndarray, faces: np.ndarray, patches: list[_Patch]
) -> tuple[np.ndarray, np.ndarray]:
    """Sign of the volume each closed patch should have, and how many others it lies in."""
    boxes = [
        (vertices[faces[p.faces]].min(axis=(0, 1)), vertices[faces[p.faces]].max(axis=(0, 1)))
        for p in patches
    ]
    around: list[list[int]] = []
    for inner, patch in enumerate(patches):
        low, high = boxes[inner]
        around.append(
            [
                outer
                for outer, (outer_low, outer_high) in enumerate(boxes)
                if outer != inner
                and bool((outer_low < low).all() and (high < outer_high).all())
                and _lies_in(_probes(vertices, faces, patch), vertices[faces[patches[outer].faces]])
            ]
        )
    depths = np.array([len(outers) for outers in around], dtype=np.int64)
    signs = np.ones(len(patches), dtype=np.int64)
    for index in np.argsort(depths, kind="stable"):
        if around[index]:
            innermost = max(around[index], key=lambda outer: depths[outer])
            alike = patches[index].volume * patches[innermost].volume >= 0
            signs[index] = signs[innermost] if alike else -signs[innermost]
    return signs, depths


def _probes(vertices: np.ndarray, faces: np.ndarray, patch: _Patch) -> np.ndarray:
    used = np.unique(faces[patch.faces])
    return vertices[used[np.linspace(0, len(used) - 1, min(_PROBES, len(used))).astype(np.int64)]]


def _lies_in(points: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether all points lie within a closed surface, by its winding number."""
    return all(abs(solid_angles(triangles, point[None]).sum()) >= 2 * np.pi for point in points)
