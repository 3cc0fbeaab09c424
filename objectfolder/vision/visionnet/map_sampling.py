"""Maps of a source brought onto the faces of the surface that an Object File stores."""

from dataclasses import replace

import numpy as np

from objectfolder.mesh.mesh import TexturedMesh
from objectfolder.mesh.normal_maps import MappedNormals
from objectfolder.surface.codec import stored_order
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.network.face_lattice import TAPS, FaceLattice
from objectfolder.vision.network.surface_maps import (
    CHANNELS,
    STEEPEST,
    UPRIGHT,
    SurfaceMaps,
    tangent_frame,
)

PITCHES = {"normal": 1 / 128, "alpha": 1 / 256, "roughness": 1 / 96, "metallic": 1 / 96}
"""Of each map's lattice, unit-frame lengths; a pixel of a data set's view of 128 pixels is 1/71."""


def stored_mesh(mesh: TexturedMesh, stored: Surface) -> TexturedMesh:
    """Return a mesh with the faces, positions and normals of its stored form, `codec.decode_surface`."""
    order, turned = stored_order(mesh.faces)
    return replace(
        mesh,
        vertices=stored.vertices,
        faces=stored.faces,
        texture_coordinates=np.take_along_axis(mesh.texture_coordinates[order], turned[..., None], axis=1),
        face_texture=mesh.face_texture[order],
        normals=stored.corner_normals,
    )


def sample_maps(mesh: TexturedMesh, frame: UnitFrame, appearance: Appearance) -> SurfaceMaps | None:
    """Sample the maps of a mesh on lattices over its faces, each value a mean over its cell.

    Parameters
    ----------
    mesh
        As `stored_mesh` returns it.
    frame
        Its unit frame.
    appearance
        Roughness and metallic where a texture has no map of them.

    Returns
    -------
    SurfaceMaps or None
        Those that the source has; None where it has none.
    """
    names = [name for name in CHANNELS if _has(mesh, name)]
    if not names:
        return None
    surface = Surface(mesh.vertices, mesh.faces, normals=mesh.normals)
    triangles = frame.to_unit(mesh.vertices)[mesh.faces]
    mapped = MappedNormals(
        mesh.vertices, mesh.faces, surface.corner_normals, mesh.texture_coordinates, mesh.face_texture,
        mesh.normal_maps,
    )  # fmt: skip
    levels = {}
    for name in names:
        lattice = FaceLattice(triangles, PITCHES[name])
        total = np.zeros((lattice.size, CHANNELS[name]))
        steps = (np.arange(TAPS) + 0.5) / TAPS - 0.5
        for offset in np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 2):
            places = lattice.places(offset)
            if name == "normal":
                total += _aside(surface, mapped, *places)
            else:
                total[:, 0] += _values(mesh, name, getattr(appearance, name, 1.0), *places)
        mean = total / TAPS**2
        levels[name] = np.rint(
            UPRIGHT + STEEPEST * mean if name == "normal" else 255 * mean
        ).astype(np.uint8)  # fmt: skip
    return SurfaceMaps(surface, triangles, {name: PITCHES[name] for name in names}, levels)


def _has(mesh: TexturedMesh, name: str) -> bool:
    if name == "normal":
        return bool(mesh.normal_maps)
    if name == "alpha":
        return any(bool((texture[..., 3] < 255).any()) for texture in mesh.textures)
    return bool(_maps(mesh, name))


def _maps(mesh: TexturedMesh, name: str) -> dict[int, np.ndarray]:
    return dict(mesh.roughness_maps if name == "roughness" else mesh.metallic_maps)


def _aside(surface: Surface, mapped: MappedNormals, face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Parts (n, 2) of bent normals along the tangent frame, those below the surface laid into it."""
    upright, bent = surface.normals_at(face, barycentric), mapped.at(face, barycentric)
    aside = np.stack(
        [np.einsum("ij,ij->i", bent, axis) for axis in tangent_frame(surface, face, upright)], axis=1
    )
    below = np.einsum("ij,ij->i", bent, upright) < 0
    length = np.maximum(np.linalg.norm(aside, axis=1), 1e-12)
    return np.asarray(np.where(below[:, None], aside / length[:, None], aside))


def _values(
    mesh: TexturedMesh, name: str, constant: float, face: np.ndarray, barycentric: np.ndarray
) -> np.ndarray:
    """Map (n,) in 0..1 at barycentric coordinates (n, 3) of faces (n,)."""
    coordinates = np.einsum("ij,ijk->ik", barycentric, mesh.texture_coordinates[face])
    values = np.full(len(face), constant)
    for texture in range(len(mesh.textures)):
        own = np.flatnonzero(mesh.face_texture[face] == texture)
        if name == "alpha":
            alpha = bilinear(mesh.textures[texture][..., 3:], coordinates[own])[:, 0]
            cutoff = mesh.alpha_cutoffs.get(texture)
            values[own] = alpha if cutoff is None else alpha >= cutoff
        elif texture in (maps := _maps(mesh, name)):
            values[own] = bilinear(maps[texture][..., None], coordinates[own])[:, 0]
    return values
