"""What loading, cleaning and ingesting a hard mesh must give, held against what is true of it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hard_meshes import (
    OBJ_SIDES,
    Truth,
    box_truth,
    encoded,
    obj_text,
    quarters,
    write_text,
)

from objectfolder.errors import InputError
from objectfolder.making.mesh.cleaning import clean
from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.making.mesh.readers.load import load_mesh
from objectfolder.products.store import Product
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.surface.textured_mesh import TexturedMesh, textured_mesh_of

Make = Callable[[Path], tuple[Path, Truth]]
BOX = box_truth(OBJ_SIDES)
GREY_BOX = box_truth(OBJ_SIDES, coloured=False)
PICTURE = encoded(quarters())


def colours_at(mesh: TexturedMesh, points: np.ndarray, within_m: float = 1e-5) -> np.ndarray:
    """SRGB (n, 3) in 0..255 of the surface nearest to points, which lie on it but for `within_m`."""
    closest = mesh.surface.closest_points(points)
    assert (closest.distance < within_m).all()
    result = np.empty((len(points), 3))
    for index, face in enumerate(closest.face):
        corner = mesh.texture_coordinates[face]
        place = closest.barycentric[[index]] @ corner
        result[index] = 255 * bilinear(mesh.textures[mesh.face_texture[face]], place)[0, :3]
    return result


def z_up(truth: Truth) -> Truth:
    """A truth in the axes of a glTF, whose y is up, as one in the axes of objects."""
    x, y, z = truth.extents_m
    colours = tuple(((at[0], -at[2], at[1]), colour) for at, colour in truth.colours)
    return replace(truth, extents_m=(x, z, y), colours=colours)


def check(path: Path, truth: Truth) -> Product:
    """Load, clean and ingest a file, and hold all three against the truth, which is in the file's axes."""
    if path.suffix in (".gltf", ".glb"):
        truth = z_up(truth)
    mesh, _ = clean(load_mesh(path))
    topology = mesh.surface.topology
    assert (topology.watertight, topology.consistent) == (truth.watertight, True)
    product = ingest_object(path, length_m=truth.length_m, object_id="hard")
    attributes = product.attributes
    assert attributes["topology"]["components"] == truth.components
    assert attributes["area_m2"] == pytest.approx(truth.area_m2, rel=truth.tolerance)
    np.testing.assert_allclose(attributes["length"]["extents_m"], truth.extents_m, rtol=truth.tolerance)
    assert attributes["solid"]["meaningful"] == (truth.volume_m3 is not None)
    if truth.volume_m3 is not None:
        assert attributes["solid"]["volume_m3"] == pytest.approx(truth.volume_m3, rel=truth.tolerance)
    if truth.faces is not None:
        assert len(product["faces"]) == truth.faces
    if truth.colours:
        points, expected = zip(*truth.colours, strict=True)
        colours = colours_at(
            textured_mesh_of(product), np.array(points), max(1e-5, truth.tolerance * max(truth.extents_m))
        )
        np.testing.assert_allclose(colours, expected, atol=1.0)
    return product


def refused(path: Path, *said: str, **options: Any) -> InputError:
    with pytest.raises(InputError) as caught:
        ingest_object(path, object_id="hard", **options)
    problem = caught.value
    assert "hard (" in problem.where
    assert path.name in problem.where or path.parent.name in problem.where
    assert problem.remedy
    for words in said:
        assert words in str(problem)
    assert "\n" not in str(problem)
    assert len(str(problem)) < 700
    return problem


def as_obj(vertices: np.ndarray, polygons: list[list[int]], truth: Truth, **options: Any) -> Make:
    def make(folder: Path) -> tuple[Path, Truth]:
        options.setdefault("material", "")
        return write_text(folder / "model.obj", obj_text(vertices, polygons, **options)), truth

    return make


def single(truth: Truth) -> Truth:
    """A truth of a file in single precision."""
    return replace(truth, tolerance=2e-6)


SINGLE = single(BOX)
