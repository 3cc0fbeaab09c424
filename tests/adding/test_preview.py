"""Pictures of what is added: to scale, cut open, walls marked."""

import numpy as np
import pytest
from PIL import Image

from objectfolder.surface.textured_mesh import TexturedMesh
from pipeline.intake.add.preview import RED, walls_marked, write_preview
from pipeline.intake.add.preview_views import CUT, draw, side_m, standard_views

WHITE = np.full((1, 1, 4), 255, dtype=np.uint8)


def mesh_of(vertices: np.ndarray, faces: np.ndarray) -> TexturedMesh:
    return TexturedMesh(
        np.asarray(vertices, dtype=np.float64),
        np.asarray(faces, dtype=np.int64),
        np.zeros((len(faces), 3, 2)),
        (WHITE,),
        np.zeros(len(faces), dtype=np.int32),
    )


def tube(wall: float, outer: float = 0.04, height: float = 0.1) -> TexturedMesh:
    """A square tube along z, open at both ends; its section through the middle is two strips."""
    rings = [(outer, -1), (outer, 1), (outer - wall, 1), (outer - wall, -1)]
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], dtype=float)
    vertices = np.concatenate(
        [np.column_stack([radius * corners, np.full(4, end * height / 2)]) for radius, end in rings]
    )
    faces = []
    for ring in range(4):
        base, next_base = 4 * ring, 4 * ((ring + 1) % 4)
        for corner in range(4):
            a, b = base + corner, base + (corner + 1) % 4
            c, d = next_base + corner, next_base + (corner + 1) % 4
            faces += [[a, b, c], [b, d, c]]
    return mesh_of(vertices, np.array(faces))


def test_the_cut_shows_the_material_to_scale():
    mesh = tube(0.008)
    views = standard_views(mesh.extents)
    side = side_m(mesh, views)
    image = draw(mesh, views[-1], side, 300)
    cut = (np.abs(image - 255 * CUT) < 2).all(axis=2).sum() * (side / 300) ** 2
    # Half of the pixels that the four edges of the two strips pass through.
    assert cut == pytest.approx(2 * 0.008 * 0.1, abs=4 * 0.1 * side / 300 / 2)


def test_all_views_show_the_whole_object_to_one_scale():
    mesh = tube(0.008)
    views = standard_views(mesh.extents)
    side = side_m(mesh, views)
    for view in views:
        image = draw(mesh, view, side, 120)
        shown = (image < 255).any(axis=2)
        assert shown.any()
        assert not np.concatenate([shown[0], shown[-1], shown[:, 0], shown[:, -1]]).any()
    from_a_side = (draw(mesh, views[2], side, 120) < 255).any(axis=2)
    assert from_a_side.any(axis=1).sum() * side / 120 == pytest.approx(0.1, abs=side / 120)
    assert from_a_side.any(axis=0).sum() * side / 120 == pytest.approx(0.08, abs=side / 120)


def test_thin_walls_are_red():
    for wall, marked in ((0.001, True), (0.006, False)):
        mesh = tube(wall)
        view = standard_views(mesh.extents)[2]
        image = draw(mesh, view, 0.2, 100, walls_marked(mesh, 0.003)).astype(int)
        reddish = image[..., 0] - image[..., 1] > 60
        assert (reddish.sum() > 1000) == marked
    assert RED[0] > RED[1]


@pytest.mark.slow
def test_the_picture_has_its_views_and_its_text(tmp_path):
    mesh = tube(0.008)
    sizes = []
    for words in (1, 60):
        lines = ["object       tube", f"walls?       {'words $ ' * words}"]
        write_preview(tmp_path / "tube.png", mesh, lines, walls_marked(mesh, 0.001))
        with Image.open(tmp_path / "tube.png") as picture:
            sizes.append(picture.size)
            image = np.asarray(picture)[..., :3]
    assert sizes[1][1] > sizes[0][1]  # the long line is broken, and the picture holds all of it
    assert (image[-40:] < 128).any()
    assert (np.abs(image - 255 * CUT) < 2).all(axis=2).sum() > 100
