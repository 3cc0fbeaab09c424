"""A solid as tetrahedra."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from objectfolder.errors import InputError
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
LOCAL_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])  # outward; face k is opposite corner k
SMALLEST_SHARE = 1e-3


@dataclass(frozen=True)
class Solid:
    """Positively oriented tetrahedra in metres; bodies share no vertex.

    Attributes
    ----------
    vertices : (v, 3) float64
    tetrahedra : (t, 4) int64
    component : (v,) int64 body of each vertex; bodies are joined through faces only
    report : what was done, JSON-able
    target : the surface whose inside it is, denser than its boundary; None for a solid that came without one
    """

    vertices: Floats
    tetrahedra: Integers
    component: Integers
    report: dict[str, Any]
    target: Surface | None = None

    @property
    def components(self) -> int:
        """Number of bodies."""
        return int(self.component.max()) + 1

    @property
    def volume_m3(self) -> float:
        """Volume, cubic metres."""
        return float(volumes(self.vertices, self.tetrahedra).sum())

    def boundary(self) -> tuple[Integers, Integers, Integers]:
        """Outward boundary triangles (f, 3), the element (f,) and the opposite local corner (f,) of each."""
        return boundary_of(self.tetrahedra)

    @cached_property
    def surface(self) -> Surface:
        """The boundary as a surface, metres, outward."""
        return Surface(self.vertices, self.boundary()[0])


def boundary_of(tetrahedra: Integers) -> tuple[Integers, Integers, Integers]:
    """Outward boundary triangles (f, 3), the element (f,) and the opposite local corner (f,) of each."""
    faces = tetrahedra[:, LOCAL_FACES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer = np.sort(first[count == 1])
    return faces[outer], outer // 4, outer % 4


def volumes(vertices: Floats, tetrahedra: Integers) -> Floats:
    """Signed volume of each tetrahedron, (t,)."""
    corner = vertices[tetrahedra]
    return np.asarray(np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6, dtype=np.float64)


def clean(vertices: Floats, tetrahedra: Integers, report: dict[str, Any], *, name: str = "solid") -> Solid:
    """Orient, drop flat elements and crumbs, and part bodies that touch only along edges or at points.

    A flat element has under 1e-12 of the cube of its longest edge; a crumb is a body with under 1e-3 of the
    volume. Joined bodies share faces: others would be hinged, and have fewer than six rigid motions each.
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    if len(tetrahedra) == 0 or not np.isfinite(vertices).all():
        raise InputError(name, "no tetrahedra, or coordinates that are not finite", "Check the mesh.")
    volume = volumes(vertices, tetrahedra)
    corner = vertices[tetrahedra]
    longest = np.max(np.linalg.norm(corner[:, :, None] - corner[:, None, :], axis=-1), axis=(1, 2))
    whole = np.abs(volume) > 1e-12 * longest**3
    inverted = volume < 0
    tetrahedra = np.where(inverted[:, None], tetrahedra[:, [0, 2, 1, 3]], tetrahedra)[whole]
    body = _bodies(tetrahedra)
    size = np.bincount(body, np.abs(volume[whole]))
    large = size >= SMALLEST_SHARE * size.sum()
    number = np.cumsum(large) - 1
    stays = large[body]
    tetrahedra, body = tetrahedra[stays], number[body[stays]]
    key = body[:, None] * len(vertices) + tetrahedra
    unique, renumbered = np.unique(key, return_inverse=True)
    report = {
        **report,
        "flat_elements_dropped": int(np.count_nonzero(~whole)),
        "bodies": int(large.sum()),
        "body_volume_shares": (size[large] / size.sum()).tolist(),
        "crumbs_dropped": int(np.count_nonzero(~large)),
        "crumbs_volume_share": float(size[~large].sum() / size.sum()),
    }
    return Solid(
        vertices[unique % len(vertices)], renumbered.reshape(key.shape), unique // len(vertices), report
    )


def _bodies(tetrahedra: Integers) -> Integers:
    """Number the bodies joined through faces, (t,)."""
    faces = np.sort(tetrahedra[:, LOCAL_FACES].reshape(-1, 3), axis=1)
    _, label = np.unique(faces, axis=0, return_inverse=True)
    label = label.reshape(-1)
    order = np.argsort(label, kind="stable")
    same = np.flatnonzero(label[order][1:] == label[order][:-1])
    first, second = order[same] // 4, order[same + 1] // 4
    count = len(tetrahedra)
    graph = sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)
