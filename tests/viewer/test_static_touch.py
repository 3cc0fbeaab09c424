"""The press of the static player against TouchNet's, in the browser."""

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion

import objectfolder
from pipeline.publish.viewer.static import write_player, write_player_assets
from tests.viewer.players import evaluated
from tests.viewer.test_static_player import PAGE


@pytest.fixture(scope="module")
def folder(small_file, tmp_path_factory):
    root = tmp_path_factory.mktemp("touched")
    write_player_assets(root / "files")
    write_player(small_file, root / "files", "bar")
    (root / "index.html").write_text(PAGE)
    return root


def test_a_press_is_as_deep_and_lies_where_the_packages_does(folder, small_file, open_page):
    """Flats, edges and corners of the bar, upright and tilted; pixels there have one sample, not four."""
    watched = open_page(folder / "index.html", viewport={"width": 700, "height": 700})
    watched.page.wait_for_selector(".player-side")
    file = objectfolder.load(small_file)
    points, normals = file.sample_contacts(24, seed=4, reachable=False)
    reached = 0
    for index, (point, normal) in enumerate(zip(points, normals, strict=True)):
        depth, tilt, azimuth = 0.0004 + 0.0001 * (index % 8), 3 * (index % 4), 77 * index % 360
        asked = f"{point.tolist()}, {normal.tolist()}, {depth}, {tilt}, {azimuth}"
        found = evaluated(
            watched.page,
            f"(touch => ({{ ...touch, depth: Array.from(touch.depth) }}))(panel.object.touch.press({asked}))",
        )
        truth = file.press(point, depth, tilt, azimuth)
        assert found["reachable"] == truth.reachable[0]
        if not truth.reachable[0]:
            assert max(found["depth"]) == 0
            continue
        reached += 1
        drawn = np.array(found["depth"]).reshape(truth.depth_m.shape[1:])
        mask = truth.mask[0]
        # The border lies within a pixel of the truth's.
        assert not (drawn > 0)[~binary_dilation(mask)].any()
        assert (drawn > 0)[binary_erosion(mask)].all()
        both = (drawn > 0) & mask
        # Metres: a fiftieth of a millimetre, of depths up to 1.1 mm.
        assert np.sqrt(np.mean((drawn - truth.depth_m[0])[both] ** 2)) < 2e-5
    assert reached > 12
    assert watched.errors == []
