"""From triangles as scanned or exported to a welded surface with outward faces.

Scans come with vertices repeated at texture seams, and with vertices that rounding made equal, so neither
the file's own indices nor welding alone gives a closed surface. Welding, then dropping what folded onto
itself, does.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from objectfolder.errors import InputError
from objectfolder.making.mesh.inner_faces import inner_faces
from objectfolder.making.mesh.orientation import consistent_patches, outward_orientation
from objectfolder.surface.connectivity import connected_pieces, edge_table
from objectfolder.surface.surface import face_normals_and_areas
from objectfolder.surface.textured_mesh import TexturedMesh

MOST_PIECES = 2000
"""Not connected to one another; what lies in what is asked of every pair. Furniture has up to 1,200."""

NESTED_REMEDY = "If the object is hollow, turn their faces inwards"

WIDEST_SEAM = 1e-4
"""Gap over the longest side between rims that lie on one another but for rounding; scans are noisier."""

_SHORTEST_NORMAL = 1e-6
"""Normals are written with length one; shorter ones are rounding."""


@dataclass(frozen=True)
class CleaningReport:
    """What cleaning found and did.

    `vertices_welded` were merged into one of equal position, or across a seam, `degenerate_faces_dropped` had
    a vertex twice,
    `folded_faces_dropped` lay on the same three vertices as another and enclosed nothing,
    `doubled_faces_dropped` lay back to back with a face of the surface, as all others of its patch did,
    `repeated_faces_dropped` repeated a face of the surface, `inner_faces_dropped` had solid on both sides
    (see `inner_faces`), `vertices_unreferenced_dropped` were left
    without a face, `faces_reversed` pointed inwards. See `orientation.Orientation` for the rest.
    """

    vertices_welded: int
    degenerate_faces_dropped: int
    folded_faces_dropped: int
    doubled_faces_dropped: int
    repeated_faces_dropped: int
    inner_faces_dropped: int
    vertices_unreferenced_dropped: int
    faces_reversed: int
    cavities: int
    nested_solids: int
    unorientable_patches: int

    def to_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)

    def nested_finding(self) -> str:
        """Say that pieces within others make these no hollower, in a phrase."""
        return f"{self.nested_solids} closed pieces lie in others, face outward like these and are solid"


def clean(mesh: TexturedMesh, where: str = "mesh") -> tuple[TexturedMesh, CleaningReport]:
    """Weld equal positions, drop what collapses or folds onto itself, turn faces outwards.

    Faces with a vertex twice go. Faces on the same three vertices go in pairs, both of each pair, as they
    enclose nothing; where such faces repeat a face of the surface one stays (see `_folded_and_repeated`), and
    where a whole patch is given a second time, back to back, one layer of it (see `_without_layers`). So do
    faces with solid on both sides (see `inner_faces.inner_faces`). Rims that are apart by rounding are made
    one where that closes the surface (see `_without_seams`). Texture coordinates and normals move with
    their corners (see `usable_normals`). Cleaning a clean mesh changes nothing.

    Parameters
    ----------
    where
        The object or file, for errors.

    Raises
    ------
    InputError
        Coordinates that are not finite, no faces left, or more than `MOST_PIECES` pieces.
    """
    if not np.isfinite(mesh.vertices).all():
        raise InputError(where, "has vertices that are not finite", "Repair the mesh")
    positions, of_vertex = welded(mesh.vertices)
    faces = of_vertex[mesh.faces]
    solid = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    folded, repeated = _folded_and_repeated(faces, solid)
    folded, doubled = _without_layers(faces, folded, everything=bool(folded[solid].all()))
    usable = solid & ~folded & ~repeated & ~doubled
    if not usable.any():
        raise InputError(
            where,
            f"no faces are left of {len(faces)}: {np.count_nonzero(~solid)} collapse to lines or points, "
            f"{np.count_nonzero(folded)} lie back to back",
            "Export a surface with an inside and an outside",
        )
    before = len(np.unique(faces[usable]))
    faces[usable] = _without_seams(positions, faces[usable])
    seams = before - len(np.unique(faces[usable]))
    usable, inner = _without_inner(positions, faces, usable)
    faces, coordinates = faces[usable], mesh.texture_coordinates[usable]
    pieces = connected_pieces(faces)[0]
    if pieces > MOST_PIECES:
        raise InputError(
            where,
            f"falls into {pieces} pieces that share no corner, more than {MOST_PIECES}",
            "Merge vertices by distance before it is exported: faces beside one another should share them",
        )
    orientation = outward_orientation(positions, faces)
    turned = orientation.reverse[:, None]
    wound = np.where(turned, faces[:, ::-1], faces)
    used, packed = np.unique(wound, return_inverse=True)
    normals = None if mesh.normals is None else mesh.normals[usable]
    if normals is not None:
        normals = np.where(turned[..., None], normals[:, ::-1], normals)
    cleaned = replace(
        mesh,
        vertices=positions[used],
        faces=packed.reshape(-1, 3).astype(np.int64),
        texture_coordinates=np.where(turned[..., None], coordinates[:, ::-1], coordinates),
        face_texture=mesh.face_texture[usable],
        normals=None if normals is None else usable_normals(positions, wound, normals, orientation.reverse),
    )
    return cleaned, CleaningReport(
        vertices_welded=len(mesh.vertices) - len(positions) + seams,
        degenerate_faces_dropped=int(np.count_nonzero(~solid)),
        folded_faces_dropped=int(np.count_nonzero(folded)),
        doubled_faces_dropped=int(np.count_nonzero(doubled)),
        repeated_faces_dropped=int(np.count_nonzero(repeated)),
        inner_faces_dropped=inner,
        vertices_unreferenced_dropped=len(positions) - seams - len(used),
        faces_reversed=int(np.count_nonzero(orientation.reverse)),
        cavities=orientation.cavities,
        nested_solids=orientation.nested_solids,
        unorientable_patches=orientation.unorientable_patches,
    )


def _without_inner(vertices: np.ndarray, faces: np.ndarray, usable: np.ndarray) -> tuple[np.ndarray, int]:
    """Leave faces with solid on both sides out of the usable ones (F,), and count them."""
    rows = np.flatnonzero(usable)
    inner = rows[inner_faces(vertices, faces[rows])]
    usable = usable.copy()
    usable[inner] = False
    return usable, len(inner)


def usable_normals(
    vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray, reversed_faces: np.ndarray
) -> np.ndarray | None:
    """Normals of a source that can be those of its surface, float32.

    Those of a reversed face turn with it where they point inwards. Left out, as zeros, are those that are
    not finite, have no length, or still lie on the inner side of their face.

    Parameters
    ----------
    vertices, faces
        (V, 3) metres and (F, 3), wound outwards.
    normals
        (F, 3, 3) of any length.
    reversed_faces
        (F,) bool, whose winding in the source was the other one.

    Returns
    -------
    (F, 3, 3) unit normals, zero where there are none; None for none at all.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> given = np.array([[[0.0, 0.6, 0.8], [0.0, 0.0, -1.0], [0.0, 0.0, 2.0]]])
    >>> usable_normals(corners, np.array([[0, 1, 2]]), given, np.array([False]))[0, :, 2].round(1).tolist()
    [0.800000011920929, 0.0, 1.0]
    """
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(normals, axis=2, keepdims=True)
    valid = np.isfinite(length) & (length > _SHORTEST_NORMAL)
    unit = np.divide(normals, length, out=np.zeros(normals.shape), where=valid)
    outwards = np.einsum("fcx,fx->fc", unit, face_normals_and_areas(vertices, faces)[0])
    turned = reversed_faces & (outwards.sum(axis=1) < 0)
    sign = np.where(turned, -1.0, 1.0)[:, None]
    usable = np.where((outwards * sign > 0)[..., None], unit * sign[..., None], 0.0)
    return usable.astype(np.float32) if usable.any() else None


def welded(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distinct positions in order of first appearance, and the new index (V,) of each vertex."""
    _, first, inverse = np.unique(vertices + 0.0, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return vertices[first[order]] + 0.0, rank[inverse.reshape(-1)]


def _folded_and_repeated(faces: np.ndarray, solid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces (F,) bool to drop: pairs on the same three vertices, and repetitions of a face of the surface.

    Two faces of opposite winding are a fold: both go. Faces of the same winding cannot come from folding.
    Where the surface around them ends at two or three of their edges they are one face of it given several
    times, and the first stays; where it does not, they are a fin on it, and go too.
    """
    folded, repeated = np.zeros(len(faces), dtype=bool), np.zeros(len(faces), dtype=bool)
    rows = np.flatnonzero(solid)
    if len(rows) == 0:
        return folded, repeated
    corners = np.sort(faces[rows], axis=1)
    triples, triple, counts = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    triple = triple.reshape(-1)
    shared = np.flatnonzero(counts > 1)
    if len(shared) == 0:
        return folded, repeated
    table = edge_table(triples)
    turns = np.roll(faces[rows], -1, axis=1)
    ascending = np.count_nonzero(turns > faces[rows], axis=1) == 2
    order, ends = np.argsort(triple, kind="stable"), np.cumsum(counts)
    for group in shared:
        members = order[ends[group] - counts[group] : ends[group]]
        forward, backward = rows[members[ascending[members]]], rows[members[~ascending[members]]]
        pairs = min(len(forward), len(backward))
        folded[forward[:pairs]] = folded[backward[:pairs]] = True
        rest = np.concatenate([forward[pairs:], backward[pairs:]])
        if len(rest) > 1:
            # The group itself counts once at each of its edges.
            ends_here = table.face_count[table.of_corner[3 * group : 3 * group + 3]] % 2 == 0
            if np.count_nonzero(ends_here) >= 2:
                repeated[rest[1:]] = True
            else:
                folded[rest[: len(rest) // 2 * 2]] = True
    return folded, repeated


def _without_layers(
    faces: np.ndarray, folded: np.ndarray, *, everything: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Faces (F,) bool of `folded` that are folds, and those that are the second layer of a surface.

    Some exports give every face a second time, wound the other way. A patch of such pairs is a surface where
    it is closed, or where there is nothing but pairs (`everything`) and none is closed; of each pair the face
    given first stays. Any other patch is a fold, which encloses nothing.
    """
    rows = np.flatnonzero(folded)
    _, first, triple = np.unique(np.sort(faces[rows], axis=1), axis=0, return_index=True, return_inverse=True)
    if len(first) == 0:
        return folded, folded
    edges = edge_table(faces[rows[first]])
    patch = consistent_patches(len(first), edges)[0]
    rims = np.bincount(patch, (edges.face_count[edges.of_corner] != 2).reshape(-1, 3).any(axis=1))
    closed = rims[patch] == 0
    is_surface = closed | (everything and not closed.any())
    of_surface, doubled = np.zeros_like(folded), np.zeros_like(folded)
    of_surface[rows] = doubled[rows] = is_surface[triple.reshape(-1)]
    doubled[rows[first]] = False
    return folded & ~of_surface, doubled


def _without_seams(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Vertex (F, 3) of each corner, those of rims within `WIDEST_SEAM` of one another made one.

    Parameters
    ----------
    vertices, faces
        (V, 3) and (F, 3), equal positions welded.

    Returns
    -------
    (F, 3) faces, those given where that would not close the surface: what has openings of its own stays as
    it is, and so does what would lose a face.
    """
    table = edge_table(faces)
    rim = np.unique(table.vertices[table.face_count == 1])
    if len(rim) == 0:
        return faces
    size = float(np.ptp(vertices[faces.reshape(-1)], axis=0).max())
    pairs = KDTree(vertices[rim]).query_pairs(WIDEST_SEAM * size, output_type="ndarray")
    if len(pairs) == 0:
        return faces
    graph = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(len(rim),) * 2)
    _, label = connected_components(graph, directed=False)
    first = np.unique(label, return_index=True)[1]
    joined = np.arange(len(vertices))
    joined[rim] = rim[first[label]]
    merged = joined[faces]
    collapsed = (merged == np.roll(merged, 1, axis=1)).any()
    return faces if collapsed or (edge_table(merged).face_count == 1).any() else merged
