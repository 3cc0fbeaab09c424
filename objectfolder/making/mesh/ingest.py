"""An object as a user names it to the cleaned, measured product that every sense starts from.

Nothing here depends on the material: masses are volumes, to be multiplied by a density.
"""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.mesh.cleaning import NESTED_REMEDY, CleaningReport, clean
from objectfolder.making.mesh.readers.load import load_mesh
from objectfolder.making.mesh.up_axis import Z_UP, up_axis
from objectfolder.making.mesh.walls import WallMeasures, measure_walls, wall_findings
from objectfolder.products.store import Product
from objectfolder.renaming import formerly_positional
from objectfolder.surface.codec import too_large
from objectfolder.surface.connectivity import Topology, connected_pieces
from objectfolder.surface.integrals import NOTHING, counted_again, solid_properties
from objectfolder.surface.textured_mesh import TexturedMesh, mesh_arrays, with_length

DEBRIS_SHARE = 0.01
"""Of the area: a piece with less is a speck, unless it is near the rest."""

DEBRIS_LENGTH = 1.2
"""Longest side with specks over that without, from which on they decide the size."""


@formerly_positional
def ingest_object(
    mesh_path: Path,
    *,
    texture_path: Path | None = None,
    length_m: float | None = None,
    object_id: str | None = None,
    with_textures: bool = True,
    up: str | None = None,
) -> Product:
    """Load, clean, scale and measure one object.

    Parameters
    ----------
    mesh_path
        OBJ, glTF, GLB, PLY, STL, OFF, 3MF, COLLADA, FBX, USD or .blend.
    texture_path
        Base colour image in place of what the mesh names; None follows the mesh.
    length_m
        Longest side of the bounding box in metres; None takes the file to be in metres.
    object_id
        Names the object in errors; None takes the name of the file without its ending.
    with_textures
        False leaves colours unread, and files that name textures that are missing usable for sound and touch.
    up
        Axis of the file that is up and becomes z; None takes y for glTF, z for all others.

    Returns
    -------
    Product
        `vertices` (vertex, axis) metres, `faces` (face, corner), `texture_coordinates` (face, corner, uv),
        `face_texture` (face), `normals` (face, corner, axis) where the source has some, and
        `texture_0`, `texture_1`, ... (y, x, channel), with `alpha_cutoff_0`, `roughness_0`, `metallic_0`,
        `normal_map_0`, ... where the source has them; in its attributes the report: cleaning, topology,
        solid, wall thickness, share of corners with normals of the source, warnings (of walls: what
        geometry alone tells), `source_up` (the axis of the file that became z, where that was another),
        digests of geometry, texture and normals, source files, measures of the walls (see `WallMeasures`).

    Raises
    ------
    InputError
        Anything that keeps the object from being used, with object or file, finding and remedy.

    Examples
    --------
    >>> from pathlib import Path
    >>> bar = ingest_object(Path("bar.obj"), length_m=0.24)  # twice as large
    >>> [round(side, 3) for side in bar.attributes["length"]["extents_m"]]
    [0.24, 0.06, 0.016]
    """
    object_id = mesh_path.stem if object_id is None else object_id
    where = f"{object_id} ({mesh_path})"
    try:
        mesh, report = clean(load_mesh(mesh_path, texture_path, with_textures=with_textures, up=up), where)
        mesh, warnings = with_length(mesh, length_m, where)
    except InputError as problem:
        if problem.where.startswith(where):
            raise
        raise InputError(f"{object_id} ({problem.where})", problem.finding, problem.remedy) from problem
    if finding := too_large(mesh.vertices, mesh.faces):
        raise InputError(where, f"has {finding}", "Decimate it: --decimate 50000 of add and build does")
    walls = measure_walls(mesh.surface)
    attributes = _measured(mesh, report, walls, [*warnings, *debris(mesh)], length_m)
    if (axis := up or up_axis(mesh_path)) != Z_UP:
        attributes["source_up"] = axis
    body = hashlib.sha256(json.dumps(attributes, sort_keys=True).encode()).hexdigest()
    texture = (mesh.texture_coordinates, mesh.face_texture, *mesh.textures, *_numbered_maps(mesh))
    attributes |= {
        "object_id": object_id,
        "source": {"mesh": _source(mesh_path), "texture": _source(texture_path) if texture_path else None},
        "walls": walls.to_dict(),
        "digests": {
            "body": body,
            "geometry": _digest(mesh.vertices, mesh.faces),
            "texture": _digest(*texture),
            "normals": _digest(*([] if mesh.normals is None else [mesh.normals])),
        },
    }
    return Product(mesh_arrays(mesh), attributes)


def _measured(
    mesh: TexturedMesh,
    report: CleaningReport,
    walls: WallMeasures,
    warnings: list[str],
    length_m: float | None,
) -> dict[str, Any]:
    """What is known of a mesh in metres, as attributes of its product."""
    topology = mesh.surface.topology
    again = counted_again(mesh.surface) if walls.closed else NOTHING
    solid = solid_properties(mesh.vertices, mesh.faces, again)
    doubts = [str(finding) for finding in wall_findings(walls)]
    return {
        "area_m2": mesh.surface.area,
        "cleaning": report.to_dict(),
        "topology": asdict(topology),
        "solid": {"meaningful": walls.closed, **solid.to_dict()},
        "wall_thickness": walls.thickness(),
        "normals_of_source": 0.0 if mesh.normals is None else float(mesh.normals.any(axis=2).mean()),
        "warnings": warnings + list(mesh.remarks) + _warnings(report, topology, walls) + doubts,
        "length": {"stated_m": length_m, "extents_m": mesh.extents.tolist()},
    }


def _warnings(report: CleaningReport, topology: Topology, walls: WallMeasures) -> list[str]:
    warnings = []
    if walls.cracked:
        warnings.append(
            f"the surface is closed but for cracks ({topology.boundary_edges} boundary edges): it sounds and "
            "weighs as if they were filled"
        )
    elif not topology.watertight:
        warnings.append(
            f"the surface is not closed ({topology.boundary_edges} boundary and "
            f"{topology.non_manifold_edges} non-manifold edges): volume, mass and inertia mean nothing"
        )
    elif not walls.closed:
        warnings.append("the surface is closed but bounds no positive volume")
    pieces = topology.components - report.cavities
    if pieces > 1 and not walls.cracked:
        warnings.append(f"the surface has {pieces} separate pieces")
    if report.nested_solids:
        warnings.append(f"{report.nested_finding()}. {NESTED_REMEDY}")
    if report.doubled_faces_dropped:
        warnings.append(
            f"{report.doubled_faces_dropped} faces lay back to back with others and were left out"
        )
    if report.inner_faces_dropped:
        warnings.append(f"{report.inner_faces_dropped} faces had solid on both sides and were left out")
    if report.unorientable_patches:
        warnings.append(f"{report.unorientable_patches} patches have no inside (Moebius strips)")
    if topology.zero_area_faces:
        warnings.append(
            f"{topology.zero_area_faces} faces have no area; they are kept to keep the surface closed"
        )
    return warnings


def debris(mesh: TexturedMesh) -> list[str]:
    """Return a sentence where pieces of hardly any area make a cleaned mesh longer than the rest of it."""
    pieces, piece = connected_pieces(mesh.faces)
    share = np.bincount(piece, mesh.surface.face_areas, pieces) / mesh.surface.area
    small = (share < DEBRIS_SHARE)[piece]
    if not small.any() or small.all():
        return []
    longest = float(mesh.extents.max())
    without = float(np.ptp(mesh.vertices[np.unique(mesh.faces[~small])], axis=0).max())
    if longest < DEBRIS_LENGTH * without:
        return []
    return [
        f"the longest side, {longest:.4g} m, is that of pieces with {share[share < DEBRIS_SHARE].sum():.2g} "
        f"of the area, {np.count_nonzero(small)} faces far from the rest: without them it is "
        f"{without:.4g} m. Leave them out of the mesh, for a stated length scales by the longest side"
    ]


def _source(path: Path) -> dict[str, str]:
    return {"file": Path(path).name, "sha256": hashlib.sha256(Path(path).read_bytes()).hexdigest()}


def _numbered_maps(mesh: TexturedMesh) -> list[np.ndarray]:
    """Cutoffs and maps, each after a number that says whose it is; none for a mesh without them."""
    arrays: list[np.ndarray] = []
    maps = (mesh.alpha_cutoffs, mesh.roughness_maps, mesh.metallic_maps, mesh.normal_maps)
    for kind, by_texture in enumerate(maps):
        for index, value in by_texture.items():
            arrays += [np.array([kind, index]), np.asarray(value)]
    return arrays


def _digest(*arrays: np.ndarray) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
