"""From triangles as scanned or exported to a welded surface with outward faces.

Scans come with vertices repeated at texture seams, and with vertices that rounding made equal, so neither
the file's own indices nor welding alone gives a closed surface. Welding, then dropping what folded onto
itself, does.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from objectfolder.errors import InputError
from objectfolder.mesh.mesh import TexturedMesh
from objectfolder.mesh.orientation import outward_orientation
from objectfolder.surface.edges import connected_pieces, edge_table

MOST_PIECES = 2000
"""Not connected to one another; what lies in what is asked of every pair. Furniture has up to 1,200."""


@dataclass(frozen=True)
class CleaningReport:
    """What cleaning found and did.

    `vertices_welded` were merged into one of equal position, `degenerate_faces_dropped` had a vertex twice,
    `folded_faces_dropped` lay on the same three vertices as another and enclosed nothing,
    `repeated_faces_dropped` repeated a face of the surface, `vertices_unreferenced_dropped` were left
    without a face, `faces_reversed` pointed inwards. See `Orientation` for the rest.
    """

    vertices_welded: int
    degenerate_faces_dropped: int
    folded_faces_dropped: int
    repeated_faces_dropped: int
    vertices_unreferenced_dropped: int
    faces_reversed: int
    cavities: int
    nested_solids: int
    unorientable_patches: int

    def to_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)


def clean(mesh: TexturedMesh, where: str = "mesh") -> tuple[TexturedMesh, CleaningReport]:
    """Weld equal positions, drop what collapses or folds onto itself, turn faces outwards.

    Faces with a vertex twice go. Faces on the same three vertices go in pairs, both of each pair, as they
    enclose nothing; where such faces repeat a face of the surface one stays (see `_folded_and_repeated`).
    Texture coordinates move with their corners. Cleaning a clean mesh changes nothing.

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
    positions, of_vertex = _welded(mesh.vertices)
    faces = of_vertex[mesh.faces]
    solid = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    folded, repeated = _folded_and_repeated(faces, solid)
    kept = solid & ~folded & ~repeated
    if not kept.any():
        raise InputError(
            where,
            f"no faces are left of {len(faces)}: {np.count_nonzero(~solid)} collapse to lines or points, "
            f"{np.count_nonzero(folded)} lie back to back",
            "Export a surface with an inside and an outside",
        )
    faces, coordinates = faces[kept], mesh.texture_coordinates[kept]
    pieces = connected_pieces(faces)[0]
    if pieces > MOST_PIECES:
        raise InputError(
            where,
            f"falls into {pieces} pieces that share no corner, more than {MOST_PIECES}",
            "Merge vertices by distance before it is exported: faces beside one another should share them",
        )
    orientation = outward_orientation(positions, faces)
    turned = orientation.reverse[:, None]
    used, packed = np.unique(np.where(turned, faces[:, ::-1], faces), return_inverse=True)
    cleaned = replace(
        mesh,
        vertices=positions[used],
        faces=packed.reshape(-1, 3).astype(np.int64),
        texture_coordinates=np.where(turned[..., None], coordinates[:, ::-1], coordinates),
        face_texture=mesh.face_texture[kept],
    )
    return cleaned, CleaningReport(
        vertices_welded=len(mesh.vertices) - len(positions),
        degenerate_faces_dropped=int(np.count_nonzero(~solid)),
        folded_faces_dropped=int(np.count_nonzero(folded)),
        repeated_faces_dropped=int(np.count_nonzero(repeated)),
        vertices_unreferenced_dropped=len(positions) - len(used),
        faces_reversed=int(np.count_nonzero(orientation.reverse)),
        cavities=orientation.cavities,
        nested_solids=orientation.nested_solids,
        unorientable_patches=orientation.unorientable_patches,
    )


def _welded(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct positions in order of first appearance, and the new index (V,) of each vertex."""
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
