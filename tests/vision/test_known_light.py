"""Sight computed from a known material: as theory has it, and stored without a network."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from small_meshes import joined
from small_visionnets import MATT, Even
from test_normal_maps import stored
from trimesh.transformations import rotation_matrix
from vision_shapes import cube, sphere

from objectfolder.batch.sight import SightBatch
from objectfolder.errors import FormatError, InputError, QueryError
from objectfolder.making.visionnet.fitting import fit_visionnet
from objectfolder.making.visionnet.map_sampling import sample_maps, stored_mesh
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.store import read_product
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.appearance import THIN, Appearance
from objectfolder.vision.cameras import look_at
from objectfolder.vision.compiled.effort import LEARNED_POINTS, Effort
from objectfolder.vision.compiled.known_light import KnownLight
from objectfolder.vision.compiled.lattice_values import LatticeLookup
from objectfolder.vision.compiled.lighting import LitSurface
from objectfolder.vision.compiled.lobes import Cast
from objectfolder.vision.compiled.radiosity import BOUNCES, COARSE_BOUNCES, Radiosity
from objectfolder.vision.compiled.renderer import CompiledRenderer
from objectfolder.vision.compiled.shading import MOST_SHADED
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.face_lattice import HALF_SIDE, FaceLattice, facing
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.surface_maps import SurfaceMaps
from objectfolder.vision.visionnet.visionnet import VisionNet
from tests.small_file import bar_mesh

CAMERA = look_at(np.array([[1.4, -1.5, 1.3]]))


class White(Even):
    albedo = 1.0


def known(appearance: Appearance = MATT) -> VisionNet:
    _, frame, maps = stored(cube())
    return VisionNet(
        maps.surface, frame, None, {}, radiance_scale=0.5, camera_radius=2.5, maps=maps, appearance=appearance
    )


def hollow_ball() -> tuple[Surface, UnitSurface, LitSurface]:
    ball = sphere(0.5, (255, 255, 255), 3)
    surface = Surface(ball.vertices, ball.faces[:, ::-1], normals=-ball.surface.corner_normals[:, ::-1])
    unit = UnitSurface(surface, UnitFrame.of_points(ball.vertices))
    return surface, unit, LitSurface(unit)


def test_light_in_a_hollow_ball_comes_back_as_the_geometric_series_says():
    surface, unit, lit = hollow_ball()
    radiosity = Radiosity(lit, unit, Even(None, MATT))
    samples = surface.sample(200, seed=1)
    lamp = np.zeros((1, 3)), np.ones((1, 3))
    irradiance = radiosity.irradiance(lamp, samples.face, samples.barycentric)
    series = sum(Even.albedo**bounce for bounce in range(1, BOUNCES + 1)) / 0.5**2
    np.testing.assert_allclose(irradiance.mean(), series, rtol=0.03)
    assert irradiance.std() < 0.1 * series


def test_coarse_light_in_a_hollow_ball_comes_back_one_bounce_less():
    surface, unit, lit = hollow_ball()
    samples = surface.sample(200, seed=1)
    lamp = np.zeros((1, 3)), np.ones((1, 3))
    irradiance = Radiosity(lit, unit, Even(None, MATT)).irradiance(
        lamp, samples.face, samples.barycentric, coarse=True
    )
    series = sum(Even.albedo**bounce for bounce in range(1, COARSE_BOUNCES + 1)) / 0.5**2
    np.testing.assert_allclose(irradiance.mean(), series, rtol=0.05)


def test_metal_in_a_hollow_ball_shows_it_in_every_direction_and_loses_nothing():
    surface, unit, lit = hollow_ball()
    light = KnownLight(lit, unit, White(None, Appearance(0.4, 1.0)))
    samples = surface.sample(300, seed=1)
    points = lit.points(samples.face, samples.barycentric, -samples.normals)
    at = np.arange(300)
    shown = light.shown(points, light.features(points), Cast(at, at, 0 * at, 0 * at + 1), 0 * at + 16)
    radiance = shown.sent(np.ones((len(shown.row), 3)))
    np.testing.assert_allclose(radiance, shown.everything, atol=1e-6)
    np.testing.assert_allclose(radiance.mean(axis=0), 1.0, atol=0.02)


def test_views_rendered_at_a_time_are_those_of_one_query_each(monkeypatch):
    monkeypatch.setattr("objectfolder.vision.compiled.radiosity.REMEMBERED", 1)
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 3)
    net, cameras = known(), np.repeat(CAMERA.reshape(1, 4, 4), 6, axis=0)
    lights = 2 * np.random.default_rng(0).normal(size=(6, 3))
    together = net.render(cameras, lights, 16, 39.6, 4)
    for view, image in enumerate(together):
        np.testing.assert_array_equal(image, net.render(CAMERA, lights[view], 16, 39.6, 4)[0])
    assert net._threads(6) == 3
    assert net._threads(1) == 1


def test_more_sub_rays_are_nearer_to_the_finest_image():
    net, lamp = known(), np.array([0.4, 0.9, 1.6])
    finest = net.render(CAMERA, lamp, 32, 39.6, 1024)
    coarse, middle, fine = (
        np.square(net.render(CAMERA, lamp, 32, 39.6, count) - finest).mean() for count in (2, 4, 64)
    )
    assert fine < 0.3 * middle < 0.1 * coarse


def test_no_more_points_are_asked_for_than_a_pixel_has_sub_samples():
    for count in (64, 128, 4096):
        effort = Effort.of(count, is_known=True, one_lamp=True)
        assert LEARNED_POINTS < effort.shaded_uneven <= min(effort.samples, MOST_SHADED)
        assert Effort.of(count).shaded_uneven == LEARNED_POINTS


def test_places_of_a_cube_that_look_one_way_share_a_value_in_the_order_of_cubes():
    triangles = hollow_ball()[1].triangles
    lattice = FaceLattice(triangles, 1 / 16)
    face, barycentric = lattice.places(np.zeros((1, 2)))
    # As `places` and kernels round: a sum of products from left to right.
    corner = np.moveaxis(triangles[face], 1, 0)
    weight = np.moveaxis(barycentric[..., None], 1, 0)
    position = weight[0] * corner[0] + weight[1] * corner[1] + weight[2] * corner[2]
    cells = np.floor((position + HALF_SIDE) * 16).astype(int)
    bits = (cells[:, :, None] >> np.arange(11)[::-1] & 1).transpose(0, 2, 1).reshape(len(cells), -1)
    keys = np.column_stack([facing(triangles)[face], bits @ (1 << np.arange(bits.shape[1])[::-1])])
    _, expected = np.unique(keys, axis=0, return_inverse=True)
    np.testing.assert_array_equal(lattice.owner, expected.ravel())
    assert lattice.size < len(lattice.owner)


def test_a_kernel_looks_up_a_lattice_as_the_lattice_does():
    lattice = FaceLattice(hollow_ball()[1].triangles, 1 / 16)
    random = np.random.default_rng(0)
    values = random.integers(0, 63, (lattice.size, 3)).astype(np.uint8)
    face = random.integers(0, 20, 200)
    barycentric = random.dirichlet(np.ones(3), 200)
    answer = LatticeLookup(lattice).interpolate(values, face, barycentric)
    np.testing.assert_array_equal(answer, lattice.interpolate(values, face, barycentric))


def test_a_convex_body_sends_itself_nothing_and_lambert_lights_it():
    net = known()
    light = np.array([0.3, -1.2, 1.0])
    shown, passes = (
        net.render(CAMERA, light, 32, 39.6),
        net.render(CAMERA, light, 32, 39.6, passes=("albedo", "normal", "mask")),
    )
    inside = passes["mask"][0] & (shown[0, ..., 3] == 1)
    assert net._rendering()._network._radiosity._exchange.max() == 0
    # The lamp is behind what the normal says is dark, and nothing but it shines.
    dark = inside & ((passes["normal"][0] @ light) < -0.5)
    lit = inside & ((passes["normal"][0] @ light) > 0.6)
    assert not shown[0][dark][:, :3].any()
    assert (shown[0][lit][:, :3] > 0).any(axis=1).all()


def test_a_file_without_a_network_opens_and_answers_alike():
    net = known(Appearance(0.4, 0.5))
    tensors, metadata = net.tensors(), net.metadata()
    assert set(tensors) == {"vision.map.albedo"}
    again = VisionNet.from_tensors(tensors, metadata, net._surface.surface, net._surface.frame)
    for lights in (np.array([0.3, -1.2, 1.0]), Environment.of("window")):
        image = net.render(CAMERA, lights, 16, 39.6, 4)
        assert image[..., :3].max() > 0
        np.testing.assert_array_equal(again.render(CAMERA, lights, 16, 39.6, 4), image)
    del metadata["appearance"]
    with pytest.raises(FormatError, match=r"vision\.grid"):
        VisionNet.from_tensors(tensors, metadata, net._surface.surface, net._surface.frame)


@pytest.mark.slow
@pytest.mark.parametrize(("appearance", "most"), [(MATT, 0.03), (Appearance(0.4, 1.0), 0.075)])
def test_pixels_of_thin_rods_are_the_mean_of_finer_ones(appearance: Appearance, most: float):
    rods = []
    for index in range(9):
        pose = rotation_matrix(np.pi / 2, (1, 0.1, 0))
        pose[:3, 3] = 0.1 * index, 0, 0.05 * (index % 3)
        rod = trimesh.creation.cylinder(0.02, 1.0, sections=12, transform=pose)
        rods.append((np.asarray(rod.vertices), np.asarray(rod.faces)))
    surface = joined(*rods)
    unit = UnitSurface(surface, UnitFrame.of_points(surface.vertices))
    renderer = CompiledRenderer.of_material(unit, Even(None, appearance), 0.5)

    def image(pixels: int) -> np.ndarray:
        lamp = np.array([[0.3, -0.9, 1.0]]), np.ones((1, 3))
        return renderer.render(CAMERA[0], *lamp, (pixels, pixels), 39.6, 64)[..., :3]

    finer = image(384).reshape(24, 16, 24, 16, 3).mean(axis=(1, 3))
    assert np.linalg.norm(image(24) - finer) < most * np.linalg.norm(finer)


def test_light_is_computed_where_base_colours_are_stated_and_else_learned(small_file: Path):
    file, views = ObjectFile.load(small_file), read_product(small_file.parent / "views.zarr.zip")
    appearance = Appearance(**views.attributes["appearance"])
    maps = sample_maps(stored_mesh(bar_mesh(), file.surface), file.frame, appearance, "known")

    def fit(material: str, maps: SurfaceMaps | None) -> VisionNet:
        few = {"steps": 1, "grid_resolution": 32}
        return fit_visionnet(file.surface, file.frame, views, maps=maps, material=material, **few)

    assert fit("known", maps).computed
    assert not fit("learned", maps).computed
    assert not fit("known", None).computed
    with pytest.raises(InputError, match="Use one of known, learned"):
        fit("guessed", maps)


def test_versions_tell_files_apart_and_batches_refuse_thin_glass(small_file: Path):
    file = ObjectFile.load(small_file)
    assert file.content().metadata["format_version"] == "3"
    net = known()
    file.sight.net = net
    assert file.content().metadata["format_version"] == "4"
    file.sight.net.glass = THIN
    with pytest.raises(QueryError, match="thin glass"):
        SightBatch([file.sight], "cpu")
