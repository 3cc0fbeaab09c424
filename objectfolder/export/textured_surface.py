"""A surface or a mesh to a GLB: what is baked, and how finely.

A surface without texture coordinates gets an atlas: a block of texels of its own for each triangle. Corners
lie on texel centres, and a block has every texel that bilinear lookup inside its triangle reads: the half
texel around the triangle is its guard band, so that no colour bleeds from block to block. (Mip maps would
mix blocks; the exported sampler has none.)
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from objectfolder.errors import InputError
from objectfolder.export.files import Credit
from objectfolder.export.gltf import Part, write_glb
from objectfolder.surface.surface import Surface
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.appearance import Appearance


@dataclass(frozen=True)
class Atlas:
    """Blocks of a square texture, row 0 on top.

    Parameters
    ----------
    side
        Texels a side.
    pitch_m
        Largest distance of neighbouring texels on the surface along the edges of a block, metres.
    column, row
        (F,) the top left texel of each block.
    columns, rows
        (F,) texel steps along the two edges of the triangle; a block is one texel larger.
    corners
        (F, 3) corner of the triangle at the block's top left, its top right, and its bottom left.
    """

    side: int
    pitch_m: float
    column: np.ndarray
    row: np.ndarray
    columns: np.ndarray
    rows: np.ndarray
    corners: np.ndarray

    def texture_coordinates(self) -> np.ndarray:
        """Return (F, 3, 2) coordinates of each face's corners in the mesh's order, v up."""
        left, top = self.column + 0.5, self.row + 0.5
        x = np.stack([left, left + self.columns, left], axis=1)
        y = np.stack([top, top, top + self.rows], axis=1)
        in_block = np.stack([x, self.side - y], axis=-1) / self.side
        result = np.empty_like(in_block)
        np.put_along_axis(result, self.corners[..., None], in_block, axis=1)
        return result

    def texels(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the texels that lookups read: row (n,), column (n,), face (n,), barycentric (n, 3).

        A guard texel outside its triangle has the nearest point along the block's edges inside it.
        """
        count = (self.columns + 1) * (self.rows + 1)
        face = np.repeat(np.arange(len(count)), count)
        within = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
        j, i = np.divmod(within, self.columns[face] + 1)
        x, y = i / self.columns[face], j / self.rows[face]
        # The farthest texel read is the far corner of a cell that the slanted edge crosses.
        read = x + y < 1 + 1 / self.columns[face] + 1 / self.rows[face] - 1e-9
        face, i, j, x, y = face[read], i[read], j[read], x[read], y[read]
        beyond = np.maximum(x + y, 1.0)
        x, y = x / beyond, y / beyond
        in_block = np.stack([1 - x - y, x, y], axis=1)
        barycentric = np.empty_like(in_block)
        np.put_along_axis(barycentric, self.corners[face], in_block, axis=1)
        return self.row[face] + j, self.column[face] + i, face, np.clip(barycentric, 0.0, 1.0)


def pack(triangles: np.ndarray, side: int, finest_m: float = 0.0) -> Atlas:
    """Return the atlas of (F, 3, 3) triangles, metres, as fine as fits a square of `side` texels.

    Parameters
    ----------
    finest_m
        Texels need lie no closer than this.

    Raises
    ------
    InputError
        More triangles than fit at one texel a corner.
    """
    edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    # The corner opposite the longest edge comes first: the block follows the two shorter ones.
    first = (np.argmax(edges, axis=1) + 2) % 3
    corners = (first[:, None] + np.arange(3)) % 3
    along = np.take_along_axis(edges, corners, axis=1)
    across, down = along[:, 0], along[:, 2]
    low = max(finest_m, 1e-9 * max(float(edges.max()), 1e-12))
    high = max(float(edges.max()), low)
    if not _fits(across, down, high, side):
        raise InputError(
            "texture side",
            f"{side} texels do not hold {len(triangles)} triangles",
            "Ask for a larger texture.",
        )
    if not _fits(across, down, low, side):
        for _ in range(24):
            middle = float(np.sqrt(low * high))
            low, high = (low, middle) if _fits(across, down, middle, side) else (middle, high)
    else:
        high = low
    columns, rows = _steps(across, high), _steps(down, high)
    placed = _shelves(columns + 1, rows + 1, side)
    assert placed is not None
    return Atlas(side, high, *placed, columns, rows, corners)


def _steps(length: np.ndarray, pitch: float) -> np.ndarray:
    return np.maximum(np.ceil(length / pitch - 1e-9), 1).astype(np.int64)


def _fits(across: np.ndarray, down: np.ndarray, pitch: float, side: int) -> bool:
    columns, rows = _steps(across, pitch) + 1, _steps(down, pitch) + 1
    if columns.max() > side or rows.max() > side or (columns * rows).sum() > side * side:
        return False
    return _shelves(columns, rows, side) is not None


def _shelves(width: np.ndarray, height: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Place rectangles on shelves, tallest first; return their columns and rows, None if they do not fit."""
    column, row = np.zeros_like(width), np.zeros_like(height)
    x = top = shelf = 0
    for index in np.lexsort((-width, -height)).tolist():
        wide, tall = int(width[index]), int(height[index])
        if x + wide > side:
            x, top, shelf = 0, top + shelf, 0
        if top + tall > side:
            return None
        shelf = max(shelf, tall)
        column[index], row[index] = x, top
        x += wide
    return column, row


# sRGB-encoded RGBA (n, 4) in 0..1 at barycentric coordinates (n, 3) of faces (n,) of the surface.
ColourOf = Callable[[np.ndarray, np.ndarray], np.ndarray]


def write_mesh(path: Path, mesh: TexturedMesh, appearance: Appearance, credit: Credit) -> dict[str, Any]:
    """Write a mesh with its own textures, nothing resampled; return what was written as JSON."""
    said = {"colour": "the source's own textures"}
    write_glb(path, mesh_parts(mesh, appearance), appearance, credit, mipmaps=True, extras=said)
    return {"triangles": len(mesh.faces), **said, "bytes": path.stat().st_size}


def mesh_parts(mesh: TexturedMesh, appearance: Appearance) -> list[Part]:
    """Return the faces of each texture of a mesh."""
    normals = mesh.surface.corner_normals
    parts = []
    for index in np.unique(mesh.face_texture).tolist():
        own = mesh.face_texture == index
        parts.append(
            Part(
                mesh.vertices[mesh.faces[own]],
                normals[own],
                mesh.texture_coordinates[own],
                mesh.textures[index],
                alpha_cutoff=mesh.alpha_cutoffs.get(index),
                metallic_roughness=_metallic_roughness(mesh, index, appearance),
                normal_map=mesh.normal_maps.get(index),
            )
        )
    return parts


def _metallic_roughness(mesh: TexturedMesh, index: int, appearance: Appearance) -> np.ndarray | None:
    """Return the (h, w, 3) map of a texture as glTF has it; None where the factors say all."""
    roughness, metallic = mesh.roughness_maps.get(index), mesh.metallic_maps.get(index)
    if roughness is None and metallic is None:
        return None
    height, width = np.max([image.shape for image in (roughness, metallic) if image is not None], axis=0)
    channels = [np.zeros((height, width), dtype=np.uint8)]
    for image, factor in ((roughness, appearance.roughness), (metallic, appearance.metallic)):
        if image is None:
            image = np.array([[round(255 * factor)]], dtype=np.uint8)
        resized = Image.fromarray(image).resize((int(width), int(height)), Image.Resampling.BILINEAR)
        channels.append(np.asarray(resized))
    return np.stack(channels, axis=-1)


def write_surface(
    path: Path,
    surface: Surface,
    colour_of: ColourOf,
    appearance: Appearance,
    credit: Credit,
    *,
    colour: str,
    side: int = 1024,
    finest_m: float = 0.0,
    vertex_colours: bool = False,
) -> dict[str, Any]:
    """Write a surface without texture coordinates, its colours baked; return what was written as JSON.

    Parameters
    ----------
    colour_of
        The colours.
    colour
        In words, what the colours are.
    side
        Texels a side of the atlas.
    finest_m
        Texels need lie no closer than this, metres.
    vertex_colours
        Colours at the corners of the faces in place of an atlas.
    """
    positions, normals = surface.vertices[surface.faces], surface.corner_normals
    said: dict[str, Any] = {"triangles": len(surface.faces), "colour": colour}
    if vertex_colours:
        face = np.repeat(np.arange(len(surface.faces)), 3)
        colours = colour_of(face, np.tile(np.eye(3), (len(surface.faces), 1)))
        parts = [Part(positions, normals, colours=colours.reshape(-1, 3, 4))]
    else:
        part, baked = baked_part(surface, colour_of, side, finest_m)
        parts = [part]
        said |= baked
    write_glb(path, parts, appearance, credit, mipmaps=False, extras=dict(said))
    return {**said, "bytes": path.stat().st_size}


def baked_part(
    surface: Surface, colour_of: ColourOf, side: int = 1024, finest_m: float = 0.0
) -> tuple[Part, dict[str, Any]]:
    """Return a surface with its colours in an atlas (see `write_surface`), and what was baked as JSON."""
    positions = surface.vertices[surface.faces]
    atlas = pack(positions, side, finest_m)
    image, baked = bake(atlas, colour_of)
    return Part(positions, surface.corner_normals, atlas.texture_coordinates(), image), {
        "texture_side": side,
        "texels_baked": baked,
        "texel_pitch_m": atlas.pitch_m,
        "texels_per_m2": baked / surface.area,
    }


def bake(atlas: Atlas, colour_of: ColourOf) -> tuple[np.ndarray, int]:
    """Return the atlas's texture (side, side, 4) uint8 and how many of its texels are used."""
    row, column, face, barycentric = atlas.texels()
    image = np.zeros((atlas.side, atlas.side, 4), dtype=np.uint8)
    image[..., 3] = 255
    image[row, column] = np.round(np.clip(colour_of(face, barycentric), 0.0, 1.0) * 255.0).astype(np.uint8)
    return image, len(row)
