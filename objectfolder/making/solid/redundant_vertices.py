"""A surface without the vertices that say nothing of its shape."""

import numpy as np

from objectfolder.extras import needs_extra
from objectfolder.surface.surface import Surface

with needs_extra("factory"):
    import manifold3d

SURFACE_TOLERANCE = 1e-6  # of the longest side, by which a surface may move


def without_redundant_vertices(surface: Surface) -> Surface:
    """Leave out vertices on straight edges and inside flat faces of a closed surface, metres.

    Triangles cut in four are one again: the new vertices lie on the chords of what may be round, and would
    say that it is not. A surface that is not a closed manifold is left as it is.
    """
    mesh = manifold3d.Mesh64(
        vert_properties=np.ascontiguousarray(surface.vertices, dtype=np.float64),
        tri_verts=np.ascontiguousarray(surface.faces, dtype=np.uint64),
    )
    whole = manifold3d.Manifold(mesh)
    if whole.status() != manifold3d.Error.NoError:
        return surface
    least = whole.simplify(SURFACE_TOLERANCE * float(np.ptp(surface.vertices, axis=0).max())).to_mesh64()
    if len(least.tri_verts) == len(surface.faces):
        return surface
    return Surface(np.array(least.vert_properties)[:, :3], np.array(least.tri_verts).astype(np.int64))
