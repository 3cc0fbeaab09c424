"""Maps of a source brought onto the faces of the surface that an Object File stores."""

from dataclasses import replace

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.making.mesh.normal_maps import MappedNormals
from objectfolder.surface.codec import stored_order
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.surface.textured_mesh import TexturedMesh
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
FINE_PITCHES = tuple(1 / count for count in (320, 384, 448, 480, 512, 576, 640))
ALBEDO_BYTES = {"learned": 64_000, "known": 279_000}
"""Of these the finest that takes no more, beside a network of 870 kB and where there is none."""

BYTES_POWER = 1.1
"""Of 1 over the pitch, at least about as which bytes grow: 2 for noise, 1 for edges."""

OF_TEXTURES = {"albedo": slice(0, 3), "alpha": slice(3, 4)}
"""Channels of the textures that are a map; the others are images of their own."""

TAPS, ALPHA_TAPS = 3, 4
"""Places along each axis of a value's cell over which it is a mean; an even number halves at an edge."""

FIT_TAPS, FIT_RELAXATION, FIT_LEVELS = 2, 1.5, 3
"""Samples along each axis of a cell by which an albedo steps from means, which blur twice where they are
interpolated, towards least squares; the length of the step; levels below which a value takes none: even
surface has few bytes."""

ROUNDED_UP = np.array([0.25, 0.75])
"""What is added to a fine albedo's values in turn before they are rounded down: neighbours, which a pixel
averages, are half a level finer together, and equal colours a pattern of few bytes."""


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
            constant = getattr(appearance, name, 1.0)
            levels[name] = _levels(mesh, surface, name, lattice, constant, taps)
    albedo = _finest_albedo(mesh, surface, triangles, material)
    if albedo is None:
        return SurfaceMaps(surface, triangles, pitches, levels)
    pitches |= albedo.pitches
    levels |= albedo.levels
    return SurfaceMaps(surface, triangles, pitches, levels, albedo.streams)


def _finest_albedo(
    mesh: TexturedMesh, surface: Surface, triangles: np.ndarray, material: str
) -> SurfaceMaps | None:
    """Return the albedo on the finest lattice within its bytes, or the coarsest; of too many faces None."""
    pitches = []
    for pitch in ALBEDO_PITCHES + (FINE_PITCHES if material == "known" else ()):
        try:
            lattice_of("albedo", triangles, pitch)
        except FormatError:  # more places than a file may have
            break
        pitches.append(pitch)
    allowed = ALBEDO_BYTES[material]
    finest, low, high = None, 0, len(pitches)
    at = high // 2
    while low < high:
        pitch = pitches[at]
        lattice = lattice_of("albedo", triangles, pitch)
        levels = (
            _fitted_albedo(mesh, lattice)
            if material == "known"
            else _levels(mesh, surface, "albedo", lattice, 1.0, TAPS)
        )
        albedo = SurfaceMaps(surface, triangles, {"albedo": pitch}, {"albedo": levels})
        albedo = replace(albedo, streams=albedo.tensors())
        size = len(albedo.streams["albedo"])
        if at and size > allowed:
            high = at
        else:
            finest, low = albedo, at + 1
        # Packing is slow, so the next pitch is the one that is likely to be the finest.
        likely = pitch * (size / allowed) ** (1 / BYTES_POWER)
        at = int(np.clip(np.count_nonzero(np.array(pitches) >= likely) - 1, low, max(low, high - 1)))
    return finest


def _fitted_albedo(mesh: TexturedMesh, lattice: FaceLattice) -> np.ndarray:
    """Return levels (size, 3) uint8 of the albedo by which what is interpolated is near to the texture."""
    # Importing numba is slow.
    from objectfolder.making.visionnet.texture_means import add_remainder

    sums = _sums(mesh, "albedo", 1.0, lattice, _taps(TAPS))
    values = lattice.mean(sums) * (255 / TAPS**2)
    remainder, weight = np.zeros_like(values), np.zeros(len(values))
    for texture, image in enumerate(mesh.textures):
        add_remainder(
            remainder, weight, values, image[..., OF_TEXTURES["albedo"]], mesh.texture_coordinates,
            mesh.face_texture == texture, lattice, _taps(FIT_TAPS),
        )  # fmt: skip
    values *= MAP_WHOLE["albedo"] / 255
    change = FIT_RELAXATION * MAP_WHOLE["albedo"] / 255 * remainder / np.maximum(weight, 1e-9)[:, None]
    values += np.where(np.abs(change).max(axis=1, keepdims=True) >= FIT_LEVELS, change, 0.0)
    turn = ROUNDED_UP[np.arange(len(values)) % len(ROUNDED_UP)]
    return np.floor(np.clip(values, 0, MAP_WHOLE["albedo"]) + turn[:, None]).astype(np.uint8)


def _taps(count: int) -> np.ndarray:
    """Return (count,) offsets of samples along an axis of a cell."""
    return (np.arange(count) + 0.5) / count - 0.5


def _levels(
    mesh: TexturedMesh, surface: Surface, name: str, lattice: FaceLattice, constant: float, taps: int
) -> np.ndarray:
    """Levels (size, channels) uint8 of a map, the constant where no texture has it."""
    steps = _taps(taps)
    if name == "normal":
        mapped = MappedNormals(
            mesh.vertices, mesh.faces, surface.corner_normals, mesh.texture_coordinates, mesh.face_texture,
            mesh.normal_maps,
        )  # fmt: skip
        offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 2)
        total = sum(_aside(surface, mapped, *lattice.places(offset)) for offset in offsets)
    else:
        total = _sums(mesh, name, constant, lattice, steps)
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


def _sums(
    mesh: TexturedMesh, name: str, constant: float, lattice: FaceLattice, steps: np.ndarray
) -> np.ndarray:
    """Sums (p, channels) of a map in 0..1 over the values about each place; albedo sRGB-encoded."""
    # Importing numba is slow.
    from objectfolder.making.visionnet.texture_means import add_texture

    places = int(lattice.counts.sum())
    sums = np.zeros((places, MAP_CHANNELS[name]))
    maps = dict(enumerate(mesh.textures)) if name in OF_TEXTURES else _maps(mesh, name)
    for texture, image in maps.items():
        channels = image[..., OF_TEXTURES[name]] if name in OF_TEXTURES else image[..., None]
        cutoff = mesh.alpha_cutoffs.get(texture) if name == "alpha" else None
        own = mesh.face_texture == texture
        add_texture(sums, channels, mesh.texture_coordinates, own, lattice, steps, cutoff)
    without = ~np.isin(mesh.face_texture, list(maps))
    sums[np.repeat(without, lattice.counts)] = constant * len(steps) ** 2
    return sums
