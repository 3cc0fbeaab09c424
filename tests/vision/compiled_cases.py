"""Surfaces and networks on which the compiled renderer is held against the reference."""

import numpy as np
from small_meshes import box, joined
from vision_shapes import cube, sphere

from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.network_layout import weight_shapes
from objectfolder.vision.network.sparse_grid import SparseGrid, covering_points


def furniture() -> Surface:
    """A rack of 16 boxes and two sheets, 196 triangles: very large and very thin ones."""
    parts = [box((x, y, 0.0), (x + 0.03, y + 0.03, 0.5)) for x in (0.0, 0.37) for y in (0.0, 0.27)]
    parts += [box((0.0, 0.0, z), (0.4, 0.3, z + 0.02)) for z in (0.1, 0.3, 0.5)]
    parts += [box((0.04 * i, 0.0, 0.52), (0.04 * i + 0.01, 0.01, 0.7)) for i in range(9)]
    sheet = np.array([[0.0, 0.3, 0.52], [0.4, 0.3, 0.52], [0.4, 0.3, 0.75], [0.0, 0.3, 0.75]])
    parts += [
        (sheet, np.array([[0, 1, 2], [0, 2, 3]])),
        (sheet - [0, 0.02, 0], np.array([[0, 2, 1], [0, 3, 2]])),
    ]
    return joined(*parts)


def mug(segments: int = 40) -> Surface:
    """A cup with a wall of 4 mm, turned about z, open at the top."""
    radius = (0.0, 0.04, 0.04, 0.04, 0.036, 0.036, 0.036, 0.0)
    height = (0.0, 0.0, 0.05, 0.1, 0.1, 0.05, 0.004, 0.004)
    angles = 2 * np.pi * np.arange(segments) / segments
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros(segments)], axis=1)
    rings = [r * around + [0, 0, z] for r, z in zip(radius, height, strict=True)]
    faces = []
    for ring in range(len(radius) - 1):
        for k in range(segments):
            a, b = ring * segments + k, ring * segments + (k + 1) % segments
            faces += [(a, b, b + segments), (a, b + segments, a + segments)]
    return Surface(np.concatenate(rings), np.array(faces))


def sheet() -> Surface:
    """An open, bent sheet seen from both sides."""
    x, y = np.meshgrid(np.linspace(0, 1, 12), np.linspace(0, 0.6, 9), indexing="ij")
    vertices = np.stack([x, y, 0.1 * np.sin(4 * x)], axis=-1).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(12, 9)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return Surface(vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]))


def degenerate() -> Surface:
    """A cube with triangles without area: points, segments, and one needle of 1e-9."""
    mesh = cube()
    vertices = np.concatenate([mesh.vertices, mesh.vertices[:1] + np.array([[0, 0, 1e-10]])])
    needles = np.array([[0, 0, 0], [0, 1, 1], [2, 3, 2], [0, 1, len(vertices) - 1]])
    return Surface(vertices, np.concatenate([needles[:2], mesh.faces, needles[2:]]))


SHAPES = {
    "sphere": lambda: sphere(0.5, (200, 200, 200)).surface,
    "cube": lambda: cube().surface,
    "open sheet": sheet,
    "mug": mug,
    "furniture": furniture,
    "degenerate": degenerate,
}


def network(
    surface: Surface, seed: int = 0, resolution: int = 16, mirrors: bool = False
) -> tuple[UnitSurface, SparseGrid, dict]:
    """A surface in its unit frame, its grid, and a network drawn at random whose colours are plain to see."""
    frame = UnitFrame.of_points(surface.vertices)
    grid = SparseGrid.of_points(
        covering_points(surface, frame.to_unit(surface.vertices), resolution), resolution
    )
    random = np.random.default_rng(seed)
    weights = {}
    for name, shape in weight_shapes(grid.sizes, mirrors=mirrors).items():
        spread = 0.5 if name.startswith("tables") else 1.0 / np.sqrt(shape[-1] if shape else 1)
        weights[name] = (random.normal(size=shape) * spread).astype(np.float16)
    weights["log_alpha"] = np.array(np.log(0.25), dtype=np.float16)
    if mirrors:
        weights["log_mirror_alpha"] = np.array(np.log(0.4), dtype=np.float16)
    return UnitSurface(surface, frame), grid, weights
