"""Solids meshed by formula, so that physics is tested apart from the mesher."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import trimesh

from objectfolder.making.materials import Material
from objectfolder.making.solid.solid import Solid, clean
from objectfolder.surface.surface import Surface


def box(cells: Sequence[int], size: Sequence[float]) -> Solid:
    """A box of size metres, each cell cut into the six tetrahedra of Kuhn."""
    counts = np.array(cells)
    grid = np.stack(np.meshgrid(*[np.arange(n + 1) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3)
    first = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3)
    strides = np.array([(counts[1] + 1) * (counts[2] + 1), counts[2] + 1, 1])
    tetrahedra = []
    for path in itertools.permutations(range(3)):
        corners = [first]
        for axis in path:
            corners.append(corners[-1] + np.eye(3, dtype=int)[axis])
        tetrahedra.append(np.stack([corner @ strides for corner in corners], axis=1))
    vertices = grid / counts * np.array(size)
    return clean(vertices, np.concatenate(tetrahedra), {})


def moved(solid: Solid, offset: Sequence[float]) -> Solid:
    """The solid elsewhere."""
    return clean(solid.vertices + np.array(offset), solid.tetrahedra, {})


def together(*solids: Solid) -> Solid:
    """Several solids as one object."""
    starts = np.cumsum([0, *[len(solid.vertices) for solid in solids]])
    return clean(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate([solid.tetrahedra + start for solid, start in zip(solids, starts[:-1], strict=True)]),
        {},
    )


def material(poisson_ratio: float = 0.19, youngs_modulus_pa: float = 7.2e10, **changes: float) -> Material:
    """Ceramic, or something near it."""
    properties = {
        "density_kg_m3": 2700.0,
        "rayleigh_alpha_per_s": 6.0,
        "rayleigh_beta_s": 1e-7,
        "roughness": 0.3,
        "metallic": 0.0,
        **changes,
    }
    return Material(
        name="test",
        youngs_modulus_pa=youngs_modulus_pa,
        poisson_ratio=poisson_ratio,
        citation="",
        **properties,
    )


@cache
def ball(subdivisions: int) -> Solid:
    """Two layers of 80 tetrahedra, or 4 or 16 times as many, in a finely drawn unit sphere.

    Bent onto it, 320 have Lamb's frequencies to 4e-5 at order 3.
    """
    skin = trimesh.creation.icosphere(subdivisions)
    count, faces = len(skin.vertices), np.sort(skin.faces, axis=1)
    inner, outer = faces + 1, faces + 1 + count
    prisms = [
        np.hstack([inner[:, : corner + 1], outer[:, corner:]])  # from a corner to the next it climbs
        for corner in range(3)
    ]
    middle = np.hstack([np.zeros((len(faces), 1), dtype=np.int64), inner])
    vertices = np.concatenate([np.zeros((1, 3)), skin.vertices / 2, skin.vertices])
    # A coarser target has facets that show: which of them a node is drawn to is a matter of rounding.
    fine = trimesh.creation.icosphere(max(subdivisions + 3, 4))
    target = Surface(np.array(fine.vertices), np.array(fine.faces))
    return replace(clean(vertices, np.concatenate([middle, *prisms]), {}), target=target)
