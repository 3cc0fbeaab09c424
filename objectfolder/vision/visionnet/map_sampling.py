"""Maps of a source brought onto the faces of the surface that an Object File stores."""

from dataclasses import replace

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.mesh.mesh import TexturedMesh
from objectfolder.mesh.normal_maps import MappedNormals
from objectfolder.surface.codec import stored_order
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.network.face_lattice import FaceLattice, facing
from objectfolder.vision.network.surface_maps import (
    MAP_CHANNELS,
    MAP_WHOLE,
    SurfaceMaps,
    lattice_of,
    tangent_frame,
)

PITCHES = {"normal": 1 / 192, "alpha": 1 / 256, "roughness": 1 / 192, "metallic": 1 / 192}
"""Of each map's lattice, unit-frame lengths; a pixel of a data set's view of 128 pixels is 1/71."""

ALBEDO_PITCHES = tuple(1 / count for count in (64, 96, 128, 160, 192, 224, 256))
FINE_PITCHES = tuple(1 / count for count in (320, 384, 448, 512))
ALBEDO_BYTES = {"learned": 64_000, "known": 160_000}
"""Of these the finest that takes no more, beside a network of 870 kB and where there is none."""

TAPS, ALPHA_TAPS = 3, 4
"""Places along each axis of a value's cell over which it is a mean; an even number halves at an edge."""


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


def sample_maps(
    mesh: TexturedMesh, frame: UnitFrame, appearance: Appearance, material: str = "learned"
) -> SurfaceMaps:
    """Sample the maps of a mesh on lattices over its faces, each value a mean over its cell.

    Parameters
    ----------
    mesh
        As `stored_mesh` returns it.
    frame
        Its unit frame.
    appearance
        Roughness and metallic where a texture has no map of them.
    material
        As of `fit_visionnet`: how fine the albedo may be.

    Returns
    -------
    SurfaceMaps
        Albedo, but of more faces than a lattice may have places; of the others those that the source has.
    """
    surface = Surface(mesh.vertices, mesh.faces, normals=mesh.normals)
    triangles = frame.to_unit(mesh.vertices)[mesh.faces]
    pitches, levels = dict[str, float](), dict[str, np.ndarray]()
    for name, pitch in PITCHES.items():
        if _has(mesh, name):
            pitches[name] = pitch
            taps = ALPHA_TAPS if name == "alpha" else TAPS
            lattice = lattice_of(name, triangles, pitch)
            levels[name] = _levels(mesh, surface, name, lattice, appearance, taps)
    albedo_pitches = ALBEDO_PITCHES + (FINE_PITCHES if material == "known" else ())

    def albedo(pitch: float, taps: int) -> tuple[np.ndarray, int]:
        """Levels, and the bytes that they take."""
        found = _levels(mesh, surface, "albedo", lattice_of("albedo", triangles, pitch), appearance, taps)
        alone = SurfaceMaps(surface, triangles, {"albedo": pitch}, {"albedo": found})
        return found, len(alone.tensors()["albedo"])

    low, high = 0, len(albedo_pitches)
    while low < high:
        middle = (low + high) // 2
        try:
            # Values at the places take hardly fewer bytes than means over cells, in a ninth of the time.
            _, size = albedo(albedo_pitches[middle], 1)
        except FormatError:  # more places than a file may have
            high = middle
            continue
        if middle and size > ALBEDO_BYTES[material]:
            high = middle
        else:
            low = middle + 1
    while low:
        pitches["albedo"] = albedo_pitches[low - 1]
        levels["albedo"], size = albedo(pitches["albedo"], TAPS)
        if low == 1 or size <= ALBEDO_BYTES[material]:
            break
        low -= 1
    return SurfaceMaps(surface, triangles, pitches, levels)


def _levels(
    mesh: TexturedMesh, surface: Surface, name: str, lattice: FaceLattice, appearance: Appearance, taps: int
) -> np.ndarray:
    """Levels (size, channels) uint8 of a map."""
    mapped = MappedNormals(
        mesh.vertices, mesh.faces, surface.corner_normals, mesh.texture_coordinates, mesh.face_texture,
        mesh.normal_maps,
    )  # fmt: skip
    steps = (np.arange(taps) + 0.5) / taps - 0.5
    total: np.ndarray | float = 0.0
    for offset in np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 2):
        places = lattice.places(offset)
        if name == "normal":
            total = total + _aside(surface, mapped, *places)
        else:
            total = total + _values(mesh, name, getattr(appearance, name, 1.0), *places)
    lowest = MAP_WHOLE[name] if name == "normal" else 0
    mean = lattice.mean(np.asarray(total) / taps**2)
    return np.asarray(np.rint(lowest + MAP_WHOLE[name] * mean).astype(np.uint8))


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
    looks = facing(surface.vertices[surface.faces])[face]
    aside = np.stack([np.einsum("ij,ij->i", bent, axis) for axis in tangent_frame(looks, upright)], axis=1)
    below = np.einsum("ij,ij->i", bent, upright) < 0
    length = np.maximum(np.linalg.norm(aside, axis=1), 1e-12)
    return np.asarray(np.where(below[:, None], aside / length[:, None], aside))


def _values(
    mesh: TexturedMesh, name: str, constant: float, face: np.ndarray, barycentric: np.ndarray
) -> np.ndarray:
    """Map (n, channels) in 0..1 at barycentric coordinates (n, 3) of faces (n,); albedo sRGB-encoded."""
    coordinates = np.einsum("ij,ijk->ik", barycentric, mesh.texture_coordinates[face])
    values = np.full((len(face), MAP_CHANNELS[name]), constant)
    for texture, image in enumerate(mesh.textures):
        own = np.flatnonzero(mesh.face_texture[face] == texture)
        if name == "albedo":
            values[own] = bilinear(image[..., :3], coordinates[own])
        elif name == "alpha":
            alpha = bilinear(image[..., 3:], coordinates[own])
            cutoff = mesh.alpha_cutoffs.get(texture)
            values[own] = alpha if cutoff is None else alpha >= cutoff
        elif texture in (maps := _maps(mesh, name)):
            values[own] = bilinear(maps[texture][..., None], coordinates[own])
    return values
