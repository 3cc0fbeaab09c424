"""The page of a scene: objects struck, carried and squeezed by mouse and keys, with a browser and without."""

import itertools
import re
import time
from concurrent.futures import Future

import numpy as np
import pytest

from objectfolder.errors import QueryError
from objectfolder.live import LiveSight
from objectfolder.live.scene_view import View
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG
from pipeline.cli import main
from pipeline.publish.opened_scene import OpenedScene, camera_over
from pipeline.publish.viewer.play import page_of_world
from pipeline.publish.viewer.played_world import ALONE_S, BLOCK_S, PlayedWorld
from tests.live.drop_scenes import drop_scene
from tests.viewer.live_servers import served_page
from tests.viewer.players import place_of

pytest.importorskip("mujoco")
TABLE = "objectfolderViewer.table"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return drop_scene(tmp_path_factory.mktemp("table"), "mug", "bell")


@pytest.fixture
def world(scene):
    return PlayedWorld(OpenedScene.of(scene))


@pytest.fixture
def played(world, open_page):
    with world.running(), served_page(page_of_world(world)) as server:
        watched = open_page(server.address, viewport={"width": 900, "height": 900})
        watched.page.wait_for_selector(".player-image[data-state]")
        yield watched.page, world
        assert watched.errors == []
        assert watched.left_the_machine == []


def waits(until, seconds=20.0):
    """Wait until something holds, on a machine that may be busy."""
    end = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < end
        time.sleep(0.02)


def place_on(page, world, body, above_m=0.05):
    """Where in the window a point over the origin of a body is."""
    point = world._world.pose(body)[:3, 3] + [0, 0, above_m]
    return place_of(page, *page.evaluate(f"(point) => {TABLE}.orbit.project(point)", point.tolist()))


def image(page):
    return page.evaluate("() => document.querySelector('.player-image').toDataURL()")


@pytest.mark.slow
def test_a_click_strikes_what_is_seen_and_heard(played):
    page, world = played
    page.wait_for_selector(".player-image[data-state=rest]")
    before = image(page)
    page.evaluate(f"() => ({TABLE}.sound.peak = 0)")
    page.mouse.click(*place_on(page, world, "0_mug"))
    waits(lambda: any(one.bodies == ("hammer", "0_mug") for one in world._sound.impacts))
    page.wait_for_function(f"() => {TABLE}.sound.peak > 1e-3")
    page.wait_for_function(
        "(before) => document.querySelector('.player-image').toDataURL() !== before", arg=before
    )
    assert page.evaluate(f"() => {TABLE}.sound.next > 0"), "it was played"
    page.evaluate(f"() => ({TABLE}.sound.next = 1e-3)")  # as if the last block had ended long ago
    page.locator(".player-resolution", has_text=re.compile("[1-9][0-9]* gaps? in the sound")).wait_for()


@pytest.mark.slow
def test_what_is_dragged_is_carried_and_thrown(played):
    page, world = played
    x, y = place_on(page, world, "1_bell")
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(1, 20):
        page.mouse.move(x - 4 * step, y - 9 * step)
        page.wait_for_timeout(30)
    waits(lambda: world._world.pose("1_bell")[2, 3] > 0.1)
    page.mouse.up()
    waits(lambda: world._world.pose("1_bell")[2, 3] < 0.07)
    azimuth = page.evaluate(f"() => {TABLE}.orbit.azimuth")
    page.mouse.move(*place_of(page, 0.05, 0.05))
    page.mouse.down()
    page.mouse.move(*place_of(page, 0.3, 0.05))
    page.mouse.up()
    assert page.evaluate(f"() => {TABLE}.orbit.azimuth") != azimuth, "beside objects the view is turned"


@pytest.mark.slow
def test_the_keyboard_squeezes_and_both_gels_are_shown(played):
    page, world = played
    page.get_by_label("Object").select_option("0_mug")
    page.get_by_role("button", name="Squeeze").press("Enter")
    page.locator("figcaption", has_text="Left finger: 4.0 N").wait_for()
    page.locator("figcaption", has_text="Right finger: 4.0 N").wait_for()
    assert page.locator(".player-touch canvas").count() == 2
    assert page.locator(".player-ring:visible").count() == 2
    page.get_by_role("button", name="Let go").press("Enter")
    page.wait_for_function("() => document.querySelector('.player-touch').hidden")
    page.locator(".player-image").press("Enter")
    for name in ("Strike", "Lift and drop", "Throw"):
        page.get_by_role("button", name=name).press("Enter")
    waits(lambda: world._world.pose("0_mug")[2, 3] > 0.03)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_fault_of_accessibility(played, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed").Axe()
    page, _ = played
    page.emulate_media(color_scheme=scheme)
    page.get_by_role("button", name="Squeeze").click()
    page.locator("figcaption", has_text="pressed").first.wait_for()
    faults = axe.run(page).response["violations"]
    assert [(fault["id"], [node["html"] for node in fault["nodes"]]) for fault in faults] == []


def test_a_world_that_nobody_asks_stands_still_and_goes_on(world):
    with world.running():
        waits(lambda: world._count > 2)
        world._asked_s -= 2 * ALONE_S
        time.sleep(5 * BLOCK_S)
        stopped = world._count
        time.sleep(10 * BLOCK_S)
        assert world._count <= stopped + 1
        waits(lambda: world.heard({"since": stopped})[0]["next"] > stopped + 1)


def test_every_block_is_heard_once_in_order(world):
    blocks = []
    for _ in range(8):
        world._advance()
        blocks.append(world._blocks[-1])
    parts = [world.heard({"since": since}) for since in (0, 3, 6)]
    for (header, sound), since in zip(parts, (0, 3, 6), strict=True):
        assert (header["first"], header["next"]) == (since, 8)
        np.testing.assert_array_equal(
            np.frombuffer(sound, "<f4"), np.concatenate(blocks[since:]).astype(np.float32)
        )


def test_the_image_at_rest_is_the_files_own(world):
    camera = camera_over(world._points)
    header, shown = world.seen({"camera_to_world": camera.tolist(), "resolution": 48, "sub_rays": None})
    expected = world._sight.image(camera, 48, sub_rays=None)
    assert shown[: 3 * 48**2] == expected.rgb.tobytes()
    assert np.array_equal(np.frombuffer(shown[3 * 48**2 :], np.int8), expected.body.ravel())
    waiting = {"camera_to_world": camera.tolist(), "resolution": 48, "stamp": header["stamp"], "wait": True}
    assert world.seen(waiting)[0]["still"]


def test_the_camera_holds_all_objects_and_is_no_farther_than_that(world):
    view = View(camera_over(world._points), (100, 100), FIELD_OF_VIEW_DEG)
    image = (world._points - view.camera[:3, 3]) @ view.camera[:3, :3]
    share = np.abs(image[:, :2] / image[:, 2:]) / np.tan(np.deg2rad(FIELD_OF_VIEW_DEG) / 2)
    assert 0.7 < share.max() <= 1.0


def test_a_scene_says_its_lamps_and_its_environment(scene, world):
    said = scene.read_text().replace(
        "<worldbody>",
        '<custom><text name="environment" data="sky"/></custom><worldbody>'
        '<light name="lamp_red" pos="0 -1 1" diffuse="1 .1 .1"/><light pos="0 0 9" diffuse="9 9 9"/>',
    )
    other = scene.with_name("lit.xml")
    other.write_text(said)
    opened, posed = OpenedScene.of(other), world._poses
    seen = opened.sight(posed).image(camera_over(world._points), 32)
    lamps = {"lamps_m": np.array([[0.0, -1.0, 1.0]]), "lamp_colours": np.array([[1.0, 0.1, 0.1]])}
    expected = LiveSight(posed, opened.files, table_m=opened.table_m, environment="sky", **lamps).image(
        camera_over(world._points), 32
    )
    assert abs(seen.rgb.astype(int) - expected.rgb).max() <= 1, "colours are float32 in the engine"
    other.write_text(said.replace("sky", "disco"))
    with pytest.raises(QueryError, match="disco"):
        OpenedScene.of(other).sight(posed)


def test_an_unstable_world_starts_again_and_says_so(world, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log where it is
    world._world._data.qvel[:] = np.nan
    world._advance()
    header, sound = world.heard({"since": 0})
    assert "smaller time step" in header["said"]
    assert not np.frombuffer(sound, "<f4").any()
    world._advance()
    assert np.isfinite(world._world.pose("0_mug")).all()


def test_what_falls_off_the_table_comes_back(world):
    world._world.strike("1_bell", world._world.pose("1_bell")[:3, 3], np.array([2.0, 0, 0]))
    fell = False
    for _ in itertools.repeat(None, 200):
        world._advance()
        fell |= world._world.pose("1_bell")[2, 3] < -0.5
    assert fell
    assert world._world.pose("1_bell")[2, 3] > -0.1


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"act": "fly"}, "act"),
        ({"act": "_begin"}, "act"),
        ({"act": "strike", "impulse": 1}, "origin"),
        ({"act": "strike", "impulse": 1e9}, "impulse"),
        ({"act": "lift", "body": "2_cup", "height": 0.1}, "body"),
        ({"act": "squeeze", "body": "0_mug", "across": [0, 0, 1], "force": 1, "lifting": 0}, "across"),
        ({"act": "grip", "force": 99, "lifting": 0}, "force"),
        ({"act": "pull", "target": [1, 2]}, "target"),
        ({"act": "throw", "body": "0_mug", "velocity": ["fast"]}, "velocity"),
    ],
)
def test_acts_that_cannot_be_done_say_why(world, asked, named):
    with world.running(), pytest.raises(QueryError, match=named):
        world.act(asked)


def test_a_failed_act_leaves_the_world_running(world):
    failed: Future = Future()
    world._acts.put((lambda: world._named({}), failed))
    world._do_acts()
    assert isinstance(failed.exception(), QueryError)


def test_what_cannot_be_opened_is_one_line(scene, tmp_path, capsys):
    (tmp_path / "empty.xml").write_text("<mujoco/>")
    (tmp_path / "broken.xml").write_text("<mujoco")
    alone = tmp_path / "alone.xml"
    alone.write_text(scene.read_text())
    for path, finding in (
        (tmp_path / "none.xml", "no scene"),
        (tmp_path / "empty.xml", "no object"),
        (tmp_path / "broken.xml", "no scene"),
        (alone, "no Object File"),
    ):
        assert main(["play", str(path), "--no-browser"]) == 1
        said = capsys.readouterr().err
        assert str(path) in said
        assert finding in said
        assert said.count("\n") == 1
