"""Pictures of what is added: to scale, cut open, walls marked."""

import numpy as np
import pytest
from PIL import Image

from objectfolder.geometry.mesh import TexturedMesh
from pipeline.intake.add.preview import MARGIN, PIXELS, RED, scale_bar_m, walls_marked, write_preview
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
        here, following = 4 * ring, 4 * ((ring + 1) % 4)
        for corner in range(4):
            a, b = here + corner, here + (corner + 1) % 4
            c, d = following + corner, following + (corner + 1) % 4
            faces += [[a, b, c], [b, d, c]]
    return mesh_of(vertices, np.array(faces))


def test_the_cut_shows_the_material_to_scale():
    mesh = tube(0.008)
    views = standard_views(mesh.extents, 2)
    side = side_m(mesh, views)
    image = draw(mesh, views[-1], side, 300)
    cut = (np.abs(image - 255 * CUT) < 2).all(axis=2).sum() * (side / 300) ** 2
    # Half of the pixels that the four edges of the two strips pass through.
    assert cut == pytest.approx(2 * 0.008 * 0.1, abs=4 * 0.1 * side / 300 / 2)


def test_all_views_show_the_whole_object_to_one_scale():
    mesh = tube(0.008)
    views = standard_views(mesh.extents, 2)
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
        view = standard_views(mesh.extents, 2)[2]
        image = draw(mesh, view, 0.2, 100, walls_marked(mesh, 0.003)).astype(int)
        reddish = image[..., 0] - image[..., 1] > 60
        assert (reddish.sum() > 1000) == marked
    assert RED[0] > RED[1]


@pytest.mark.parametrize(
    ("side", "bar"), [(0.2, 0.05), (0.149, 0.02), (3.0, 1.0), (0.02, 0.005), (0.03, 0.01), (6.5, 2.0)]
)
def test_scale_bars_are_round_and_fit(side, bar):
    assert scale_bar_m(side) == pytest.approx(bar)


def test_the_picture_has_its_bar_and_its_text(tmp_path):
    mesh = tube(0.008)
    lines = ["object       tube", f"walls?       {'words ' * 60}"]
    write_preview(tmp_path / "tube.png", mesh, lines, least_wall_m=0.001, up_axis=1)
    with Image.open(tmp_path / "tube.png") as picture:
        image = np.asarray(picture)
    side = side_m(mesh, standard_views(mesh.extents, 1))
    from_the_margin = (image[2 * PIXELS :, MARGIN:] == 0).all(axis=2)
    longest = max(np.argmin(row) for row in from_the_margin)
    assert longest == pytest.approx(scale_bar_m(side) / side * PIXELS, abs=3)
    assert image.shape[1] == 3 * PIXELS + 2 * MARGIN
    # The long line is broken, and the last of it is still in the picture.
    assert (image[-2 * MARGIN - 17 * 2 :] < 128).any()
