"""The page of a scene: objects struck, carried and squeezed by mouse and keys, with a browser and without."""

import contextlib
import http.client
import itertools
import json
import re
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

import av
import numpy as np
import pytest

from objectfolder import EXAMPLES
from objectfolder.errors import QueryError
from objectfolder.live import LiveSight
from objectfolder.live.scene_view import View
from objectfolder.live.sound import BLOCK_SAMPLES
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG
from objectfolder.vision.lamps import Lamps
from pipeline.cli import main
from pipeline.publish.demo import write_demo
from pipeline.publish.scenes.opened_scene import OpenedScene, camera_over
from pipeline.publish.viewer import played_world
from pipeline.publish.viewer.play import page_of_world
from pipeline.publish.viewer.played_world import ALONE_S, BLOCK_S, PlayedWorld
from tests.live.drop_scenes import drop_scene
from tests.patience import wait_until
from tests.viewer.live_servers import served_page
from tests.viewer.players import place_of

mujoco = pytest.importorskip("mujoco")
TABLE = "document.querySelector('.player').objectfolderTable"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return drop_scene(tmp_path_factory.mktemp("table"), "mug", "bell")


@pytest.fixture(scope="module")
def files(scene):
    return OpenedScene.of(scene).files


@pytest.fixture
def world(scene, files):
    spec = mujoco.MjSpec.from_file(str(scene))
    table = PlayedWorld(OpenedScene(spec, spec.compile(), files))
    yield table
    table.close()


@pytest.fixture
def played(world, open_page):
    with world.running(), served_page(page_of_world(world)) as server:
        watched = open_page(server.address, viewport={"width": 900, "height": 900})
        watched.page.wait_for_selector(".player-image[data-state]")
        yield watched.page, world
        assert watched.errors == []
        assert watched.left_the_machine == []


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
    wait_until(lambda: any(impact.bodies == ("hammer", "0_mug") for impact in world._sound.impacts))
    page.wait_for_function(f"() => {TABLE}.sound.peak > 1e-3")
    page.wait_for_function(
        "(before) => document.querySelector('.player-image').toDataURL() !== before", arg=before
    )
    before = page.evaluate(f"() => [{TABLE}.sound.underruns, {TABLE}.sound.behind]")
    world._acts.put((lambda: time.sleep(2.0), Future()))  # the world comes late
    page.wait_for_function(f"(before) => {TABLE}.sound.underruns > before", arg=before[0])
    pattern = re.compile(r"gaps? in the sound, now 0\.\d+ s late")
    page.locator(".player-resolution", has_text=pattern).wait_for()
    behind = page.evaluate(f"() => {TABLE}.sound.behind")
    assert before[1] < behind <= 0.5 or before[1] == behind == 0.5, "a busy machine may be at the most before"


@pytest.mark.slow
def test_what_is_seen_and_heard_is_saved(played):
    page, world = played
    page.wait_for_function(f"() => {TABLE}.sound.behind > 0")
    with page.expect_download() as picture:
        page.get_by_role("button", name="Save picture").click()
    assert Path(picture.value.path()).read_bytes().startswith(b"\x89PNG")
    page.get_by_role("button", name="Record clip").click()
    for _ in range(3):  # the clip has what the canvas showed, however long an image takes
        before = image(page)
        page.mouse.click(*place_on(page, world, "0_mug"))
        page.wait_for_function(
            "(before) => document.querySelector('.player-image').toDataURL() !== before", arg=before
        )
    with page.expect_download() as clip:
        page.get_by_role("button", name="Stop and save clip").click()
    with av.open(clip.value.path()) as recorded:
        assert {stream.type for stream in recorded.streams} == {"video", "audio"}
        assert len(list(recorded.decode(video=0))) > 1


def test_the_demo_is_a_scene_of_all_examples_that_stand(tmp_path):
    opened = OpenedScene.of(write_demo(tmp_path))
    assert {name.partition("_")[2] for name in opened.files} == {
        path.stem for path in EXAMPLES.glob("*.safetensors")
    }
    data = mujoco.MjData(opened.model)
    mujoco.mj_forward(opened.model, data)
    before = data.xpos.copy()
    while data.time < 0.5:
        mujoco.mj_step(opened.model, data)
    np.testing.assert_allclose(data.xpos, before, atol=0.005)
    assert (data.xmat[1:, 8] > 0.99).all(), "upright"


@pytest.mark.slow
def test_the_player_joins_blocks_waits_longer_after_a_gap_and_catches_up(world, open_page):
    """Ramps into a player of 44.1 kHz without a device: each sample says which one it is."""
    with served_page(page_of_world(world)) as server:
        page = open_page(server.address).page
        heard, reports = page.evaluate(
            """async (parts) => {
              const context = new OfflineAudioContext(1, 4 * 44100, 44100);
              await context.audioWorklet.addModule("sound_player.js");
              const player = new AudioWorkletNode(context, "sound-player", {
                numberOfInputs: 0, outputChannelCount: [1],
              });
              player.connect(context.destination);
              const { port1, port2 } = new MessageChannel(), told = [];
              player.port.onmessage = ({ data }) => told.push(data);
              player.port.postMessage(port1, [port1]);
              let next = 1;
              for (const { at, samples } of parts)
                context.suspend(at).then(async () => {
                  for (let left = samples; left > 0; left -= 512)
                    port2.postMessage(Float32Array.from({ length: Math.min(512, left) }, () => next++));
                  await new Promise((done) => setTimeout(done, 300));
                  context.resume();
                });
              const sound = await context.startRendering();
              while (told.length < 4) await new Promise((done) => setTimeout(done, 20));
              return [Array.from(sound.getChannelData(0)), told];
            }""",
            # Too little to begin, then more; a gap; far too much at once.
            [
                {"at": at, "samples": samples}
                for at, samples in ((0.0, 34 * 128), (0.5, 80 * 128), (1.5, 80000))
            ],
        )
    first, second, *_ = np.split(np.array(heard), np.flatnonzero(np.diff(np.array(heard) > 0)) + 1)[1::2]
    np.testing.assert_array_equal(first, np.arange(1, 1 + 114 * 128))
    assert heard.index(1.0) / 44100 == pytest.approx(0.5, abs=0.01)
    assert heard.index(second[0]) / 44100 == pytest.approx(1.5, abs=0.01)
    assert [(report["underruns"], report["skips"]) for report in reports] == [(0, 0), (1, 0), (1, 1), (2, 1)]
    assert [report["behind"] for report in reports] == pytest.approx([0.12, 0.15, 0.15, 0.18], abs=1e-4)
    steps, skipped = np.diff(second), 80000 - len(second)
    assert skipped == pytest.approx(80000 - 44100 - 0.15 * 44100, abs=512)
    assert 1 < steps.max() < 1.1 * skipped / 512, "faded over, not cut"


@pytest.mark.slow
def test_what_is_dragged_is_carried_and_thrown(played):
    page, world = played
    x, y = place_on(page, world, "1_bell")
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(1, 20):
        page.mouse.move(x - 4 * step, y - 12 * step)
        page.wait_for_timeout(30)
    wait_until(lambda: world._world.pose("1_bell")[2, 3] > 0.1)
    page.mouse.up()
    wait_until(lambda: world._world.pose("1_bell")[2, 3] < 0.07)
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
    page.wait_for_function("() => document.querySelectorAll('.player-ring:not([hidden])').length === 2")
    page.get_by_role("button", name="Let go").press("Enter")
    page.wait_for_function("() => document.querySelector('.player-touch').hidden")
    page.locator(".player-image").press("Enter")
    for name in ("Strike", "Lift and drop", "Throw"):
        page.get_by_role("button", name=name).press("Enter")
    wait_until(lambda: world._world.pose("0_mug")[2, 3] > 0.03)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scheme", ["light", pytest.param("dark", marks=pytest.mark.release("pipeline.publish"))]
)
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
        wait_until(lambda: world._count > 2)
        world._asked_s -= 2 * ALONE_S
        time.sleep(5 * BLOCK_S)
        stopped = world._count
        time.sleep(10 * BLOCK_S)
        assert world._count <= stopped + 1
        wait_until(lambda: world.heard({"since": stopped})[0]["next"] > stopped + 1)


def test_no_image_begins_while_the_world_is_late(world, monkeypatch):
    monkeypatch.setattr(played_world, "WAIT_S", 20.0)
    camera = camera_over(world._points).tolist()
    monkeypatch.setattr(world, "_advance", lambda: time.sleep(2 * BLOCK_S))
    with world.running(), ThreadPoolExecutor() as threads:
        world._asked_s += 1000.0
        wait_until(lambda: not world._on_time.is_set())
        future = threads.submit(world.seen, {"camera_to_world": camera, "resolution": 16, "sub_rays": 1})
        time.sleep(10 * BLOCK_S)
        assert not future.done()
        monkeypatch.setattr(world, "_advance", lambda: None)
        wait_until(future.done)
        assert future.result()[0]["resolution"] == 16


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
    expected = world.sight(world._poses).image(camera, 48, sub_rays=None)
    assert shown[: 3 * 48**2] == expected.rgb.tobytes()
    assert np.array_equal(np.frombuffer(shown[3 * 48**2 :], np.int8), expected.body.ravel())
    waiting = {"camera_to_world": camera.tolist(), "resolution": 48, "stamp": header["stamp"], "wait": True}
    assert world.seen(waiting)[0]["still"]


def test_an_image_that_moves_is_a_draft_and_says_how_long_it_took(world):
    query = {"camera_to_world": camera_over(world._points).tolist(), "resolution": 48}
    header, shown = world.seen({**query, "draft": True})
    expected = world.sight(world._poses).image(camera_over(world._points), 48, draft=True)
    assert shown[: 3 * 48**2] == expected.rgb.tobytes()
    assert header["drawn_ms"] > 0


def test_an_image_is_of_the_latest_block_of_sound(world):
    camera = camera_over(world._points)
    world._world.lift("0_mug", 0.05)
    for _ in range(8):  # it falls
        world._advance()
    shown = world.seen({"camera_to_world": camera.tolist(), "resolution": 48, "sub_rays": 1})[1]
    expected = world.sight(world._world).image(camera, 48, sub_rays=1)
    assert shown[: 3 * 48**2] == expected.rgb.tobytes()


def test_an_image_that_cannot_be_drawn_says_why(world):
    query = {"camera_to_world": np.zeros((4, 4)).tolist(), "resolution": 16}
    with pytest.raises(QueryError, match="rigid"):
        world.seen(query)
    query["camera_to_world"] = camera_over(world._points).tolist()
    assert world.seen(query)[0]["resolution"] == 16, "the process goes on"
    world._drawing.close()
    with pytest.raises(QueryError, match="has ended"):
        world.seen(query)


def test_sound_comes_block_by_block_on_one_connection(world):
    for _ in range(4):
        world._advance()
    with served_page(page_of_world(world)) as server:
        port = urlsplit(server.address).port
        with contextlib.closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as connection:
            connection.request("POST", "/heard", '{"since": 1}', {"Content-Type": "application/json"})
            answer, heard = connection.getresponse(), []
            for _ in range(2):
                part = answer.read(int.from_bytes(answer.read(4), "little"))
                length = int.from_bytes(part[:4], "little")
                header = json.loads(part[4 : 4 + length])
                heard.append((header["first"], header["next"], len(part) - 4 - length))
                world._advance()
                world._advance()
        assert heard == [(1, 4, 3 * 4 * BLOCK_SAMPLES), (4, 6, 2 * 4 * BLOCK_SAMPLES)]


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
    lit_scene = scene.with_name("lit.xml")
    lit_scene.write_text(said)
    opened, posed = OpenedScene.of(lit_scene), world._poses
    picture = opened.sight(posed).image(camera_over(world._points), 32)
    lights = [Lamps([[0.0, -1.0, 1.0]], [[1.0, 0.1, 0.1]]), "sky"]
    expected = LiveSight(posed, opened.files, table_m=opened.table_m, lights=lights).image(
        camera_over(world._points), 32
    )
    assert abs(picture.rgb.astype(int) - expected.rgb).max() <= 1, "colours are float32 in the engine"
    lit_scene.write_text(said.replace("sky", "disco"))
    with pytest.raises(QueryError, match="disco"):
        OpenedScene.of(lit_scene).sight(posed)


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
    world._acts.put((lambda: world._body({}), failed))
    world._do_acts()
    assert isinstance(failed.exception(), QueryError)


@pytest.mark.usefixtures("quiet")
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
