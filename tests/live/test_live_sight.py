"""Several objects in one image: who is in front, whose shadow falls where, and what one alone looks like."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import objectfolder
from objectfolder.errors import QueryError
from objectfolder.live import LiveSight
from objectfolder.live.matt_body import MattBody
from objectfolder.live.scene_layers import TABLE_ALBEDO, DrawnObject
from objectfolder.live.surroundings import wood_albedo
from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG, look_at, pixel_rays
from objectfolder.vision.compositing import on_white, srgb_decode, srgb_encode
from objectfolder.vision.environment import Environment, named_map, pixel_directions
from objectfolder.vision.lamps import LIGHT_POWER_W, Lamps

CAMERA = look_at(np.array([[0.1, -0.45, 0.35]]), np.array([[0.0, 0.0, 0.03]]))[0]
SIZE = (60, 80)


class Still:
    """Bodies that stay where they are."""

    timestep_s, time_s = 0.002, 0.0

    def __init__(self, poses):
        self._poses = poses

    def pose(self, body):
        if body not in self._poses:
            raise QueryError("files", f"no body {body!r} in the simulation", "Name its bodies.")
        return self._poses[body]


def placed(file, x, y, turn):
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[:3, 3] = x, y, -file.surface.bounds[0][2]
    return pose


@pytest.fixture(scope="module")
def files():
    return {"cup": objectfolder.example("mug"), "bell": objectfolder.example("bell")}


@pytest.fixture(scope="module")
def still(files):
    return Still(
        {"cup": placed(files["cup"], -0.05, -0.03, 1.0), "bell": placed(files["bell"], -0.07, 0.1, 0.3)}
    )


def centres():
    pixels = np.arange(SIZE[0] * SIZE[1])
    return pixel_rays(CAMERA, pixels, np.array([[0.5, 0.5]]), SIZE, 39.6)


def first_hits(files, still, origins, directions):
    """Distances (bodies, n) along rays in the world, by each surface alone."""
    distances = []
    for name, file in files.items():
        pose = still.pose(name)
        hits = file.surface.ray_hits((origins - pose[:3, 3]) @ pose[:3, :3], directions @ pose[:3, :3])
        distances.append(hits.distance)
    return np.array(distances)


def test_the_nearest_body_is_seen(files, still):
    image = LiveSight(still, files, table_m=None).image(CAMERA, SIZE)
    origins, directions = centres()
    distances = first_hits(files, still, origins, directions)
    expected = np.where(np.isfinite(distances.min(axis=0)), distances.argmin(axis=0), -1)
    both = np.isfinite(distances).all(axis=0)
    assert both.sum() > 20, "one stands in front of the other"
    assert (image.body.ravel() == expected).mean() > 0.999
    depth = distances.min(axis=0) * -(directions @ CAMERA[:3, 2])
    met = np.isfinite(depth) & np.isfinite(image.depth_m.ravel())
    np.testing.assert_allclose(image.depth_m.ravel()[met], depth[met], atol=1e-6)


def test_one_object_alone_is_its_own_image(files, still):
    lamp, colour = np.array([[0.4, -0.6, 0.8]]), np.array([[2.0, 1.0, 0.5]])
    sight = LiveSight(
        still, {"cup": files["cup"]}, lights=Lamps(lamp, colour), table_m=None, exposure_factor=1.0
    )
    back = np.linalg.inv(still.pose("cup"))
    # Light falls with the square of metres in the scene, of its own unit in an Object File.
    lamps = Lamps((back @ [*lamp[0], 1])[:3], colour[0] / files["cup"].frame.scale ** 2)
    alone = files["cup"].render_linear(back @ CAMERA, lamps, SIZE, sub_rays=4)
    image = sight.image(CAMERA, SIZE)
    np.testing.assert_array_equal(image.rgb, on_white(alone)[0])
    assert (image.rgb < 250).any()


def test_a_table_is_lit_by_the_law_of_squares_where_no_shadow_falls(files, still):
    lamp = np.array([-0.5, -0.3, 0.35])
    settings = {
        "lights": lamp[None],
        "table_m": (1.0, 0.0),
        "exposure_factor": 2.0,
    }
    lit = LiveSight(still, files, shadows=False, **settings).image(CAMERA, SIZE)
    dark = LiveSight(still, files, **settings).image(CAMERA, SIZE)
    origins, directions = centres()
    table = (lit.body.ravel() < 0) & np.isfinite(lit.depth_m.ravel())
    points = (origins - directions * (origins[:, 2:] / directions[:, 2:]))[table]
    away = lamp - points
    distance = np.linalg.norm(away, axis=1)
    radiance = LIGHT_POWER_W / (4 * np.pi**2) * away[:, 2] / distance**3 * 0.42
    whole = (lit.rgb.reshape(-1, 3)[table][:, 0] / 255 - srgb_encode(2 * radiance)) * 255
    assert np.quantile(abs(whole), 0.9) < 0.51, "but where an object covers a part of the pixel"
    hidden = np.isfinite(first_hits(files, still, points, away).min(axis=0))
    shaded = (dark.rgb != lit.rgb).any(axis=-1).ravel()[table]
    assert 0.03 < hidden.mean() < 0.5
    assert (shaded == hidden).mean() > 0.97, "but where an object covers a part of the pixel"


def test_one_object_shades_another(files):
    lamp = {"lights": [[0.6, 0.0, 0.2]], "exposure_factor": 20.0}
    between = Still(
        {"cup": placed(files["cup"], 0.0, 0.0, 0.0), "bell": placed(files["bell"], 0.15, 0.0, 0.0)}
    )
    lit = LiveSight(between, {"cup": files["cup"]}, **lamp).image(CAMERA, SIZE)
    shaded = LiveSight(between, files, **lamp).image(CAMERA, SIZE)
    same = (lit.body == 0) & (shaded.body == 0)
    assert lit.rgb[same].mean() > shaded.rgb[same].mean() + 5


def test_a_body_at_the_camera_or_behind_it_is_no_failure(files):
    for place in (CAMERA[:3, 3], CAMERA[:3, 3] + CAMERA[:3, 2]):
        pose = np.eye(4)
        pose[:3, 3] = place
        LiveSight(Still({"bell": pose}), {"bell": files["bell"]}, table_m=None).image(CAMERA, 32)


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({"lights": [0, 0, 1]}, "lights: lamps of shape"),
        ({"lights": Lamps([[0, 0, 1]], [1, 1, 1])}, "lights: lamps of shape"),
        ({"lights": [[np.nan, 0, 1]]}, "lights"),
        ({"lights": ["sky", "window"]}, "lights: 2 environments"),
        ({"lights": "disco"}, "light"),
        ({"table_m": (0.0, 0.0)}, "table_m"),
        ({"exposure_factor": -1.0}, "exposure_factor"),
    ],
)
def test_bad_scenes_are_refused(files, still, changed, name):
    with pytest.raises(QueryError, match=name):
        LiveSight(still, files, **changed)


def test_lamps_and_environments_by_their_old_names_warn(files, still):
    lamp, colour = np.array([[0.4, -0.6, 0.8]]), np.array([[2.0, 1.0, 0.5]])
    with pytest.warns(
        DeprecationWarning, match="use `lights` in place of lamps_m, lamp_colours, environment"
    ):
        old = LiveSight(
            still, files, lamps_m=lamp, lamp_colours=colour, environment="sky", exposure_factor=1.0
        )
    new = LiveSight(still, files, lights=[Lamps(lamp, colour), "sky"], exposure_factor=1.0)
    np.testing.assert_array_equal(old.image(CAMERA, 24).rgb, new.image(CAMERA, 24).rgb)


def test_a_body_that_is_not_there_or_flies_off_is_named(files, still):
    with pytest.raises(QueryError, match="spoon"):
        LiveSight(still, {"spoon": files["cup"]})
    lost = Still({"cup": np.full((4, 4), np.nan)})
    with pytest.raises(QueryError, match=r"cup.*not finite"):
        LiveSight(lost, {"cup": files["cup"]}).image(CAMERA)


def test_an_image_that_does_not_fit_into_memory_is_refused(files, still):
    with pytest.raises(QueryError, match=r"resolution: .* GB, more than"):
        LiveSight(still, files).image(CAMERA, 1 << 20)


def test_one_ray_a_pixel_is_the_radiance_at_its_centre(files, still):
    lamp, pose = np.array([[0.4, -0.6, 0.8]]), still.pose("cup")
    sight = LiveSight(
        still,
        {"cup": files["cup"]},
        lights=lamp,
        table_m=None,
        exposure_factor=1.0,
    )
    image = sight.image(CAMERA, SIZE, sub_rays=1)
    origins, directions = centres()
    back = pose[:3, :3]
    expected = files["cup"].radiance(
        (origins - pose[:3, 3]) @ back, directions @ back,
        Lamps((lamp - pose[:3, 3]) @ back, 1 / files["cup"].frame.scale ** 2 * np.ones(3)),
    )  # fmt: skip
    np.testing.assert_array_equal(image.rgb.reshape(-1, 3), on_white(expected))
    assert np.array_equal(image.body.ravel() >= 0, expected[:, 3] > 0)
    fine = sight.image(CAMERA, SIZE)
    np.testing.assert_allclose(image.depth_m, fine.depth_m, atol=1e-6)
    assert abs(image.rgb.astype(float) - fine.rgb).mean() < 3, "but for edges"


@pytest.mark.parametrize("sub_rays", [1, 4])
def test_what_is_kept_of_images_before_changes_none(files, still, sub_rays):
    poses = {name: still.pose(name).copy() for name in files}
    moving = Still(poses)
    settings = {"exposure_factor": 2.0}
    sight = LiveSight(moving, files, **settings)
    for turn, camera in ((0.0, CAMERA), (0.0, CAMERA), (0.7, CAMERA), (0.7, look_at(CAMERA[:3, 3] * 1.1)[0])):
        poses["bell"] = placed(files["bell"], -0.07, 0.06, turn)
        fresh = LiveSight(moving, files, **settings).image(camera, SIZE, sub_rays=sub_rays)
        image = sight.image(camera, SIZE, sub_rays=sub_rays)
        np.testing.assert_array_equal(image.rgb, fresh.rgb)
        np.testing.assert_array_equal(image.depth_m, fresh.depth_m)
        np.testing.assert_array_equal(image.body, fresh.body)


def test_a_moving_image_shows_what_moved_by_a_tenth_of_a_pixel(files):
    poses = {"cup": placed(files["cup"], 0.0, 0.0, 0.0)}
    sight = LiveSight(Still(poses), {"cup": files["cup"]}, exposure_factor=1.0)
    pixel_m = 0.57 / (SIZE[1] / 2 / np.tan(np.deg2rad(39.6 / 2)))
    for sub_rays, moved_m, same in (
        (1, 0.05 * pixel_m, True),
        (1, pixel_m, False),
        (4, 0.05 * pixel_m, False),
    ):
        poses["cup"] = placed(files["cup"], 0.0, 0.0, 0.0)
        before = sight.image(CAMERA, SIZE, sub_rays=sub_rays)
        poses["cup"] = placed(files["cup"], moved_m, 0.0, 0.0)
        after = sight.image(CAMERA, SIZE, sub_rays=sub_rays)
        assert np.array_equal(before.depth_m, after.depth_m) == same


@pytest.mark.parametrize("sub_rays", [1, 4])
def test_one_object_in_an_environment_is_its_own_image(files, still, sub_rays):
    """The cup stands unturned but moved in the world: maps look the same from everywhere."""
    moved = Still({"cup": placed(files["cup"], -0.05, -0.03, 0.0)})
    image = LiveSight(moved, {"cup": files["cup"]}, lights="window", table_m=None, exposure_factor=1.0).image(
        CAMERA, SIZE, sub_rays=sub_rays
    )
    alone = files["cup"].render(np.linalg.inv(moved.pose("cup")) @ CAMERA, "window", SIZE, sub_rays=sub_rays)
    np.testing.assert_array_equal(image.rgb, alone[0])
    assert (image.rgb < 250).any()


def test_an_environment_stays_in_the_world_where_an_object_turns(files):
    """A quarter turn of the object is one of the map the other way: an eighth of its columns, twice."""
    quarter = Still({"cup": placed(files["cup"], 0.0, 0.0, np.pi / 2)})
    sky = named_map("sky")
    image = LiveSight(quarter, {"cup": files["cup"]}, lights="sky", table_m=None, exposure_factor=1.0).image(
        CAMERA, SIZE
    )
    turned = np.roll(sky, len(sky) // 2, axis=1)  # columns run clockwise, seen from above
    alone = files["cup"].render(
        np.linalg.inv(quarter.pose("cup")) @ CAMERA, Environment.of(turned), SIZE, sub_rays=4
    )[0]
    assert np.quantile(abs(image.rgb.astype(float) - alone), 0.99) <= 1
    fixed = LiveSight(
        Still({"cup": placed(files["cup"], 0.0, 0.0, 0.0)}), {"cup": files["cup"]}, lights="sky",
        table_m=None, exposure_factor=1.0,
    ).image(CAMERA, SIZE)  # fmt: skip
    assert abs(image.rgb.astype(float) - fixed.rgb)[image.body == 0].mean() > 1


def test_a_draft_is_nearly_the_image(files):
    """Where both rays of a pixel's centre meet the object: highlights and soft shadows are approximate."""
    poses = {
        "cup": placed(files["cup"], 0.0, 0.0, 1.0),
        "bell": placed(files["bell"], -0.02, 0.15, 2.0),
    }
    sight = LiveSight(Still(poses), files, lights="window", exposure_factor=0.6)
    exact, draft = (sight.image(CAMERA, SIZE, **how) for how in ({"sub_rays": 1}, {"draft": True}))
    np.testing.assert_allclose(draft.depth_m, exact.depth_m, atol=1e-6)
    inside = (draft.body >= 0) & (exact.body == draft.body)
    inside &= ~(np.abs(np.gradient(draft.body)).max(axis=0) > 0)
    assert inside.sum() > 300
    apart = draft.rgb[inside].astype(float) - exact.rgb[inside]
    assert abs(apart).mean() < 12
    assert abs(apart.mean()) < 8
    table = (draft.body < 0) & np.isfinite(draft.depth_m)
    assert (draft.rgb == exact.rgb)[table].mean() > 0.97, "but at the edges of objects"
    with pytest.raises(QueryError, match="sub_rays"):
        sight.image(CAMERA, SIZE, sub_rays=0)


def test_lamps_and_environments_add_up_and_so_do_colours(files, still):
    lamps = np.array([[0.4, -0.6, 0.8], [-0.5, -0.3, 0.35]])
    settings = {"exposure_factor": 0.5}

    def linear(*lights):
        sight = LiveSight(still, files, lights=list(lights), **settings)
        return srgb_decode(sight.image(CAMERA, SIZE).rgb / 255.0)

    colours = np.array([[1.0, 0, 0], [0.5, 0, 0]]), np.array([[0, 0.5, 0], [0, 1.0, 0]])
    red, green, both = (Lamps(lamps, colour) for colour in (*colours, sum(colours)))
    grey = Environment.of(np.full((8, 16, 3), 0.1))
    inside = linear(both)[..., 0] < 0.98  # not the white behind the table
    total = linear(both, grey)
    parts = linear(red) + linear(green) + linear(grey)
    step = 0.012  # of three images in whole steps of sRGB
    close = abs(total - parts)[inside] < step
    assert close.mean() > 0.99, "but at edges, on white"
    assert linear(red)[inside][:, 1:2].max() < linear(both)[inside][:, 1:2].max()


def test_a_table_in_a_white_furnace_shows_its_albedo(files, still):
    furnace = {"lights": Environment.of(np.ones((8, 16, 3))), "exposure_factor": 1.0}
    image = LiveSight(still, files, **furnace, shadows=False).image(CAMERA, SIZE)
    shown = image.rgb[(image.body < 0) & np.isfinite(image.depth_m)]
    middle = np.median(shown, axis=0)
    np.testing.assert_allclose(middle / 255, srgb_encode(np.array(TABLE_ALBEDO)), atol=0.003)


def test_a_matt_slab_is_seen_as_a_table_and_dark_from_below(files, still):
    box = trimesh.creation.box(bounds=[[-0.5, -0.5, -0.01], [0.5, 0.5, 0.0]])
    slab = MattBody(Surface(box.vertices, box.faces), TABLE_ALBEDO)
    poses = Still({"cup": still.pose("cup"), "slab": np.eye(4)})
    table = LiveSight(poses, {"cup": files["cup"]}, exposure_factor=1.0).image(CAMERA, SIZE)
    for sub_rays in (1, 4):
        image = LiveSight(
            poses, {"cup": files["cup"]}, matt={"slab": slab}, table_m=None, exposure_factor=1.0
        ).image(CAMERA, SIZE, sub_rays=sub_rays)
        alike = abs(image.rgb.astype(int) - table.rgb).max(axis=2) <= 1
        assert alike[table.body < 0].mean() > 0.97, "but at the edges of shadows and of the cup"
        assert np.array_equal(image.body >= 0, table.body >= 0)
        both = np.isfinite(image.depth_m) & np.isfinite(table.depth_m)
        np.testing.assert_allclose(image.depth_m[both], table.depth_m[both], atol=1e-6)
        assert both.sum() > 0.97 * np.isfinite(table.depth_m).sum(), "but at the table's edge"
    below = look_at(np.array([[0.1, -0.2, -0.4]]), np.array([[0.0, 0.0, 0.0]]))[0]
    dark = LiveSight(poses, {}, matt={"slab": slab}, table_m=None, exposure_factor=1.0).image(below, SIZE)
    assert np.isfinite(dark.depth_m).any()
    assert not dark.rgb[np.isfinite(dark.depth_m)].any()


def test_a_matt_body_hides_and_shades_as_an_object_of_its_surface(files, still):
    """A file's own image beside it is the same: only who throws the shadow differs."""
    body = MattBody(files["bell"].surface)
    as_file = LiveSight(still, files, exposure_factor=1.0).image(CAMERA, SIZE)
    as_matt = LiveSight(still, {"cup": files["cup"]}, matt={"bell": body}, exposure_factor=1.0)
    image = as_matt.image(CAMERA, SIZE)
    np.testing.assert_allclose(image.depth_m, as_file.depth_m, atol=1e-6)
    np.testing.assert_array_equal(image.body == 0, as_file.body == 0)
    elsewhere = as_file.body != 1
    assert (abs(image.rgb.astype(int) - as_file.rgb).max(axis=2) <= 1)[elsewhere].mean() > 0.98


@pytest.mark.parametrize(
    "lights", ["window", [np.array([[0.2, -0.3, 0.9]]), "sky"]], ids=["alone", "beside a lamp"]
)
def test_a_matt_slab_takes_an_environment_as_the_table_does(files, lights):
    box = trimesh.creation.box(bounds=[[-0.5, -0.5, -0.01], [0.5, 0.5, 0.0]])
    slab = MattBody(Surface(box.vertices, box.faces), TABLE_ALBEDO)
    turned = Rotation.from_euler("z", 70, degrees=True).as_matrix()
    pose = np.eye(4)
    pose[:3, :3] = turned
    settings = {"lights": lights, "exposure_factor": 0.5}
    table = LiveSight(Still({}), {}, **settings).image(CAMERA, SIZE)
    image = LiveSight(Still({"slab": pose}), {}, matt={"slab": slab}, table_m=None, **settings).image(
        CAMERA, SIZE
    )
    both = np.isfinite(image.depth_m) & np.isfinite(table.depth_m)
    assert both.mean() > 0.3
    alike = abs(image.rgb.astype(int) - table.rgb).max(axis=2) <= 2
    assert alike[both].mean() > 0.97, "but at their edges"


def test_a_warm_scene_has_a_wooden_table_as_light_as_a_plain_one_before_a_backdrop(files, still):
    plain, warm = (
        LiveSight(still, files, exposure_factor=1.0, warm=warm).image(CAMERA, SIZE) for warm in (False, True)
    )
    np.testing.assert_array_equal(warm.depth_m, plain.depth_m)
    table = (plain.body < 0) & np.isfinite(plain.depth_m)
    assert warm.rgb[table].mean() == pytest.approx(plain.rgb[table].mean(), rel=0.2)
    behind = ~np.isfinite(plain.depth_m)
    assert (plain.rgb[behind] == 255).all()
    assert not (warm.rgb[behind] == 255).all()
    again = LiveSight(still, files, exposure_factor=1.0, warm=True).image(CAMERA, SIZE)
    np.testing.assert_array_equal(again.rgb, warm.rgb)


def test_grain_that_is_finer_than_a_pixel_fades_into_the_same_wood():
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 400), np.linspace(-0.5, 0.5, 400))
    points = np.stack([x, y], axis=-1)
    fine, coarse = (wood_albedo(points, np.full(x.shape, pixel_m)) for pixel_m in (0.001, 0.05))
    np.testing.assert_allclose(fine.mean(axis=(0, 1)), coarse.mean(axis=(0, 1)), rtol=0.05)
    assert fine.mean() == pytest.approx(np.mean(TABLE_ALBEDO), rel=0.3)
    assert fine.std(axis=1).mean() > 3 * coarse.std(axis=1).mean()
    assert fine.min() > 0
    assert fine.max() < 1


def test_an_object_that_stands_is_not_drawn_again_when_sizes_take_turns(files, still, monkeypatch):
    sight = LiveSight(still, files)
    first = [sight.image(CAMERA, size, sub_rays=1).rgb for size in ((24, 24), (32, 32))]
    monkeypatch.setattr(DrawnObject, "of", None)
    for image, size in zip(first, ((24, 24), (32, 32)), strict=True):
        np.testing.assert_array_equal(sight.image(CAMERA, size, sub_rays=1).rgb, image)


def test_objects_hide_an_environment_from_the_table(files):
    """Against every pixel of the map, asked for by rays from what the camera sees of the table."""
    cup, size, factor = files["cup"], (40, 40), 0.4
    still = Still({"cup": placed(cup, 0.0, 0.0, 0.4)})
    settings = {"lights": "window", "exposure_factor": factor}
    image = LiveSight(still, {"cup": cup}, **settings).image(CAMERA, size)
    bare = LiveSight(still, {"cup": cup}, **settings, shadows=False).image(CAMERA, size)
    radiance, (directions, solid_angle) = named_map("window"), pixel_directions(128)
    arriving = (radiance * (directions[..., 2] * solid_angle[:, None])[..., None])[:64].reshape(-1, 3) / np.pi
    towards = directions[:64].reshape(-1, 3)
    table = (image.body < 0) & np.isfinite(image.depth_m)
    pixels = np.argwhere(table)[:: max(1, table.sum() // 60)]
    starts, along = pixel_rays(CAMERA, pixels @ [size[1], 1], np.array([[0.5, 0.5]]), size, FIELD_OF_VIEW_DEG)
    points = starts - along * (starts[:, 2:] / along[:, 2:])
    turn, place = still.pose("cup")[:3, :3], still.pose("cup")[:3, 3]
    errors, darkest = [], 1.0
    for (row, column), point in zip(pixels, points, strict=True):
        from_m = np.broadcast_to(point + np.array([0, 0, 1e-5]), towards.shape)
        hidden = cup.surface.occluded((from_m - place) @ turn, (from_m + towards - place) @ turn)
        share = arriving[~hidden].sum(axis=0) / arriving.sum(axis=0)
        shown = srgb_decode(image.rgb[row, column] / 255) / srgb_decode(bare.rgb[row, column] / 255)
        errors.append(abs(shown - share).max())
        darkest = min(darkest, share.min())
    assert darkest < 0.6
    assert np.max(errors) < 0.06
    assert np.mean(errors) < 0.015
