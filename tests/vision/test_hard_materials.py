"""Materials that go wrong quietly, each rendered by Cycles and held to a closed form.

Flat quads that do not see one another reflect light once: where they are matt, the radiance follows from the
passes alone, albedo P max(0, n.l) / (4 pi^2 d^2), so that one comparison tests image and passes together.
"""

import multiprocessing
import resource
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from kept_renderers import render_in_kept

from objectfolder.making.mesh.readers.load import load_mesh
from objectfolder.making.views.cycles_process import render_in_children
from objectfolder.making.views.passes import Passes, cast_passes
from objectfolder.making.views.render_request import Scene, Shots
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import look_at, pixel_rays
from objectfolder.vision.compositing import composite_on_white, srgb_decode
from objectfolder.vision.lamps import LIGHT_POWER_W
from objectfolder.vision.network.incidence import bent_share

pytestmark = pytest.mark.slow

LAMBERT = Appearance(roughness=1.0, metallic=0.0, specular=0.0)
SIZE = (24, 36)
FIELD_OF_VIEW = 40.0
FRONT = look_at(np.array([[0.0, -2.5, 0.0]]))
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
# A 4 x 4 texture without a symmetry: red, green, blue and white quarters.
QUARTERS = np.array([[[200, 0, 0], [0, 200, 0]], [[0, 0, 200], [200, 200, 200]]], np.uint8)
QUARTERS = np.dstack([QUARTERS.repeat(8, 0).repeat(8, 1), np.full((16, 16), 255, np.uint8)])


def uniform(*rgba: int) -> np.ndarray:
    return np.array([[rgba]], dtype=np.uint8)


def scene(quads, appearance=LAMBERT, **maps) -> Scene:
    """Quads that face -y, each (centre x, y, half side, texture, texture coordinates of its corners)."""
    vertices, coordinates = [], []
    for x, y, half, _, uv in quads:
        vertices += [[x + half * (2 * u - 1), y, half * (2 * v - 1)] for u, v in SQUARE]
        coordinates += [uv[[0, 1, 2]], uv[[0, 2, 3]]]
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(len(quads))[:, None, None]
    mesh = TexturedMesh(
        np.array(vertices),
        faces.reshape(-1, 3),
        np.array(coordinates),
        tuple(quad[3] for quad in quads),
        np.repeat(np.arange(len(quads), dtype=np.int32), 2),
    )
    return Scene(
        mesh.vertices, mesh.faces, mesh.surface.corner_normals, mesh.texture_coordinates, mesh.face_texture,
        mesh.textures, appearance, **maps,
    )  # fmt: skip


def shots_of(light, cameras=FRONT, samples=16, field_of_view=FIELD_OF_VIEW) -> Shots:
    lights = np.broadcast_to(light, (len(cameras), 3)).astype(float)
    return Shots(cameras, lights, np.arange(len(cameras)), samples, *SIZE, field_of_view)


def rendered(scene: Scene, light, cameras=FRONT, samples=16, field_of_view=FIELD_OF_VIEW) -> np.ndarray:
    """(n, 24, 36, 4) float64 linear premultiplied."""
    return render_in_kept(scene, shots_of(light, cameras, samples, field_of_view)).astype(np.float64)


def matt_radiance(passes: Passes, view: int, pose, light, field_of_view=FIELD_OF_VIEW) -> np.ndarray:
    """Radiance (24, 36, 3) of single reflection, from the passes of a view."""
    pixels = np.arange(SIZE[0] * SIZE[1])
    origins, directions = pixel_rays(pose, pixels, np.array([[0.5, 0.5]]), SIZE, field_of_view)
    mask = passes.mask[view].ravel()
    depth = np.where(mask, passes.depth[view].ravel(), 1.0)
    points = origins + directions * (depth / -(directions @ pose[:3, 2]))[:, None]
    towards = light - points
    distance = np.linalg.norm(towards, axis=1)
    normal = passes.normal[view].reshape(-1, 3).astype(float)
    cosine = np.maximum((normal * towards).sum(axis=1) / distance, 0)
    irradiance = LIGHT_POWER_W / (4 * np.pi**2) * cosine / distance**2
    return (passes.albedo[view].reshape(-1, 3) * irradiance[:, None]).reshape(*SIZE, 3)


def assert_matt(rgba: np.ndarray, scene: Scene, light, least_share: float = 0.9) -> Passes:
    """Image and passes agree wherever a pixel is not crossed by an edge of a quad or a texel."""
    passes = cast_passes(scene, FRONT, SIZE, FIELD_OF_VIEW)
    whole = rgba[..., 3] == 1
    np.testing.assert_array_equal(rgba[..., 3] > 0.5, passes.mask[0])
    expected = matt_radiance(passes, 0, FRONT[0], np.asarray(light))
    agrees = np.isclose(rgba[..., :3], expected, rtol=0.02, atol=2e-3).all(axis=-1)
    assert agrees[whole].mean() > least_share
    return passes


def test_white_on_white():
    light = np.array([0.3, -1.2, 0.2])
    white = scene([(0.0, 0.0, 0.4, uniform(255, 255, 255, 255), SQUARE)])
    rgba = rendered(white, light)[0]
    passes = assert_matt(rgba, white, light, 0.99)
    np.testing.assert_array_equal(passes.albedo[0][passes.mask[0]], 1.0)
    # On white only what is below full radiance can be told from the background; alpha and mask always can.
    assert composite_on_white(rgba)[~passes.mask[0]].min() > 0.5
    assert 0.1 < rgba[..., 3].mean() < 0.5


def test_black_object():
    rgba = rendered(scene([(0.0, 0.0, 0.4, uniform(0, 0, 0, 255), SQUARE)]), [0.0, -1.0, 0.0])[0]
    assert (rgba[..., :3] == 0).all()
    assert composite_on_white(rgba)[12, 18].tolist() == [0, 0, 0]
    np.testing.assert_array_equal(rgba[0, 0], 0)


def test_texture_of_one_colour():
    """Many texels of one colour shine like one texel of it, and neither shows a seam."""
    colour = (180, 90, 60, 255)
    many = np.tile(uniform(*colour), (64, 32, 1))
    pair = scene([(-0.3, 0.0, 0.25, many, SQUARE), (0.3, 0.0, 0.25, uniform(*colour), SQUARE)])
    light = [0.0, -1.1, 0.2]
    rgba = rendered(pair, light)[0]
    assert_matt(rgba, pair, light, 0.99)
    whole = (rgba[..., 3] == 1) & (rgba[:, ::-1, 3] == 1)
    np.testing.assert_allclose(rgba[whole], rgba[:, ::-1][whole], rtol=0.02)


@pytest.fixture(scope="module")
def coordinates() -> tuple[np.ndarray, Passes]:
    """One texture three times: as it is, mirrored, and many repeats away."""
    mirrored, far = SQUARE * [-1, 1] + [1, 0], np.add(SQUARE, [7, -12])
    row = scene(
        [(-0.5, 0.0, 0.22, QUARTERS, SQUARE), (0.0, 0.0, 0.22, QUARTERS, mirrored),
         (0.5, 0.0, 0.22, QUARTERS, far)]
    )  # fmt: skip
    light = [0.1, -1.3, 0.4]
    rgba = rendered(row, light)[0]
    return rgba, assert_matt(rgba, row, light, 0.6)


def colour_names(image: np.ndarray, place_x: float) -> list[str]:
    """Name of the colour at the middle of each quarter of a quad: upper left, upper right, lower left, ..."""
    focal = 18 / np.tan(np.radians(FIELD_OF_VIEW / 2)) / 2.5
    names = []
    for z in (0.11, -0.11):
        for x in (place_x - 0.11, place_x + 0.11):
            rgb = image[int(12 - z * focal), int(18 + x * focal), :3]
            high = rgb > 0.5 * rgb.max()
            names.append("white" if high.all() else ["red", "green", "blue"][int(np.argmax(rgb))])
    return names


def test_mirrored_texture_coordinates(coordinates):
    rgba, passes = coordinates
    for image in (rgba, passes.albedo[0].astype(float)):
        assert colour_names(image, -0.5) == ["red", "green", "blue", "white"]
        assert colour_names(image, 0.0) == ["green", "red", "white", "blue"]
    normals = passes.normal[0][passes.mask[0]].astype(float)
    np.testing.assert_allclose(normals, np.broadcast_to([0.0, -1.0, 0.0], normals.shape))


def test_texture_coordinates_outside_the_unit_square_repeat(coordinates):
    rgba, passes = coordinates
    for image in (rgba, passes.albedo[0].astype(float)):
        assert colour_names(image, 0.5) == colour_names(image, -0.5)


def test_no_texture(tmp_path):
    """A mesh that names no material has sRGB 0.8."""
    corners = [f"v {0.8 * u - 0.4} 0 {0.8 * v - 0.4}" for u, v in SQUARE]
    (tmp_path / "bare.obj").write_text("\n".join([*corners, "f 1 2 3 4"]) + "\n")
    mesh = load_mesh(tmp_path / "bare.obj")
    bare = Scene(
        mesh.vertices, mesh.faces, mesh.surface.corner_normals, mesh.texture_coordinates, mesh.face_texture,
        mesh.textures, LAMBERT,
    )  # fmt: skip
    passes = assert_matt(rendered(bare, [0.2, -1.0, 0.0])[0], bare, [0.2, -1.0, 0.0], 0.99)
    np.testing.assert_allclose(passes.albedo[0][12, 18].astype(float), srgb_decode(0.8), atol=1e-3)


def with_hole(opaque_alpha: int = 255) -> np.ndarray:
    """A black leaf of 20 x 20 texels with a hole of alpha 0 in its middle 6 x 6."""
    leaf = np.zeros((20, 20, 4), dtype=np.uint8)
    leaf[..., 3] = opaque_alpha
    leaf[7:13, 7:13, 3] = 0
    return leaf


def test_alpha_holes_let_light_through_onto_what_is_behind():
    """Two leaves, hole behind hole, before a wall; seen from the front and from between."""
    wall_colour = uniform(188, 188, 188, 255)
    leaves = scene(
        [(0.0, -0.4, 0.5, with_hole(), SQUARE), (0.0, -0.3, 0.5, with_hole(), SQUARE),
         (0.0, 0.4, 0.5, wall_colour, SQUARE)],
        alpha_cutoffs={0: 0.5},
    )  # fmt: skip
    between = look_at(np.array([[0.0, -0.2, 0.0]]), np.array([0.0, 1.0, 0.0]))
    light = np.array([0.0, -1.4, 0.0])
    front = rendered(leaves, light)[0]
    front_passes = cast_passes(leaves, FRONT, SIZE, FIELD_OF_VIEW)
    np.testing.assert_array_equal(front[..., 3] > 0.5, front_passes.mask[0])
    assert front_passes.depth[0, 12, [13, 18]] == pytest.approx([2.1, 2.9])
    np.testing.assert_array_equal(front[12, 13, :3], 0)
    assert front[12, 13, 3] == front[12, 18, 3] == 1
    expected = srgb_decode(188 / 255) * LIGHT_POWER_W / (4 * np.pi**2) / 1.8**2
    np.testing.assert_allclose(front[11:13, 17:19, :3], expected, rtol=0.01)
    inside = rendered(leaves, light, between, samples=64, field_of_view=100.0)[0]
    passes = cast_passes(leaves, between, SIZE, 100.0)
    np.testing.assert_allclose(passes.depth[0][passes.mask[0]], 0.6, atol=1e-5)
    row, column = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    step = 0.6 * np.tan(np.radians(50)) / 18
    off_axis = np.maximum(np.abs(column - 18), np.abs(row - 12)) * step
    # The nearer leaf's hole of half side 0.15 at 1.1 from the light throws a patch of 0.15 * 1.8 / 1.1.
    patch = 0.15 * 1.8 / 1.1
    direct = matt_radiance(passes, 0, between[0], light, 100.0)
    lit, dark = off_axis < patch - 0.06, passes.mask[0] & (off_axis > patch + 0.06)
    assert lit.sum() > 20
    assert dark.sum() > 50
    np.testing.assert_allclose(inside[lit][:, :3], direct[lit], rtol=0.01)
    np.testing.assert_array_equal(inside[dark][:, :3], 0)


def test_alpha_that_blends_is_coverage():
    """Nothing behind a leaf of alpha 0.6: that much is covered, and the straight colour is not darkened."""
    light = np.array([0.0, -1.0, 0.0])
    texture = uniform(188, 188, 188, 153)
    rgba = rendered(scene([(0.0, 0.0, 0.4, texture, SQUARE)]), light, samples=1024)[0, 11:13, 17:19]
    np.testing.assert_allclose(rgba[..., 3], 0.6, atol=0.02)
    expected = srgb_decode(188 / 255) * LIGHT_POWER_W / (4 * np.pi**2)
    np.testing.assert_allclose(rgba[..., :3] / rgba[..., 3:], expected, rtol=0.03)


# Columns of a quad of half side 0.4 whose pixels lie whole in one half of it and off the rim, where the
# texture repeats.
LEFT, RIGHT = slice(12, 17), slice(19, 24)


def halves(left: int, right: int) -> np.ndarray:
    image = np.full((64, 64), left, dtype=np.uint8)
    image[:, 32:] = right
    return image


def test_roughness_map_with_a_sharp_border():
    """Glossy half and matt half: each is what a surface of that roughness alone would be."""
    black, light = uniform(0, 0, 0, 255), [0.0, -1.0, 0.0]
    quad = [(0.0, 0.0, 0.4, black, SQUARE)]
    mapped = rendered(scene(quad, Appearance(), roughness_maps={0: halves(64, 255)}), light)[0]
    glossy = rendered(scene(quad, Appearance(roughness=64 / 255)), light)[0]
    matt = rendered(scene(quad, Appearance(roughness=1.0)), light)[0]
    np.testing.assert_allclose(mapped[:, LEFT], glossy[:, LEFT], rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(mapped[:, RIGHT], matt[:, RIGHT], rtol=0.02, atol=1e-4)
    assert mapped[12, 16, 0] > 5 * mapped[12, 19, 0]


def test_metallic_map():
    """The metal half has no diffuse colour but tints its reflection; the other half is a dielectric."""
    red, light = uniform(220, 30, 30, 255), [0.0, -1.0, 0.0]
    quad = [(0.0, 0.0, 0.4, red, SQUARE)]
    mapped = rendered(scene(quad, Appearance(0.3), metallic_maps={0: halves(255, 0)}), light)[0]
    metal = rendered(scene(quad, Appearance(0.3, metallic=1.0)), light)[0]
    dielectric = rendered(scene(quad, Appearance(0.3, metallic=0.0)), light)[0]
    np.testing.assert_allclose(mapped[:, LEFT], metal[:, LEFT], rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(mapped[:, RIGHT], dielectric[:, RIGHT], rtol=0.02, atol=1e-4)
    assert mapped[12, 16, 0] > 2 * mapped[12, 19, 0]
    tint = srgb_decode(30 / 255) / srgb_decode(220 / 255)
    assert mapped[12, 16, 1] / mapped[12, 16, 0] == pytest.approx(tint, rel=0.05)


@pytest.mark.parametrize("light", [[-0.6, -1.0, -0.4], [0.8, -0.7, 0.5]])
def test_constant_map_of_normals_shades_as_a_tilted_plane(light):
    """But for what bumps hide of light that grazes them, which `bent_share` has as Cycles does."""
    tilted = np.array([0.36, 0.48, 0.8])
    image = np.rint(127.5 * (tilted + 1)).astype(np.uint8).reshape(1, 1, 3)
    quad = scene([(0.0, 0.0, 0.4, uniform(220, 220, 220, 255), SQUARE)], normal_maps={0: image})
    passes = cast_passes(quad, FRONT, SIZE, FIELD_OF_VIEW)
    mask = passes.mask[0]
    # u runs along x, v along z, and the quad faces -y.
    np.testing.assert_allclose(
        passes.normal[0][mask], np.broadcast_to([0.36, -0.8, 0.48], (mask.sum(), 3)), atol=0.005
    )
    light = np.array(light)
    column, row = np.meshgrid(np.arange(SIZE[1]) + 0.5, np.arange(SIZE[0]) + 0.5)
    width = 2 * 2.5 * np.tan(np.radians(FIELD_OF_VIEW / 2)) / SIZE[1]
    points = np.stack([(column - 18) * width, np.zeros(SIZE), (12 - row) * width], axis=-1)
    towards = light - points
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    bent, upright = passes.normal[0].astype(float), np.array([[0.0, -1.0, 0.0]])
    share = bent_share(
        upright.repeat(mask.sum(), 0), bent[mask], towards[mask]
    ) * -towards[mask][:, 1] / (bent[mask] * towards[mask]).sum(axis=1)  # fmt: skip
    expected = matt_radiance(passes, 0, FRONT[0], light)[mask] * share[:, None]
    rgba = rendered(quad, light)[0]
    whole = rgba[..., 3][mask] == 1
    np.testing.assert_allclose(rgba[mask][whole][:, :3], expected[whole], rtol=0.01, atol=1e-3)


# A bare child takes 310 MiB, the texture 64 MiB a copy.
LARGEST_PEAK_KIB = 640 * 1024


@pytest.mark.release("objectfolder.vision", "objectfolder.making.views")
def test_texture_of_4096_texels_a_side_stays_below_640_mib():
    # A process of its own: the peak is that of the largest child so far, and this one has had others.
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as alone:
        centre, albedo, peak_kib = alone.submit(_large_texture).result()
    assert centre == pytest.approx(albedo, rel=0.05)
    assert peak_kib < LARGEST_PEAK_KIB


def _large_texture() -> tuple[float, float, int]:
    """Albedo seen in the middle of a noisy 4096 texture, its mean, and the renderer's peak memory."""
    random = np.random.default_rng(0)
    texture = random.integers(0, 256, (4096, 4096, 4), dtype=np.uint8)
    texture[..., 3] = 255
    light = [0.0, -1.0, 0.0]
    quad = scene([(0.0, 0.0, 0.4, texture, SQUARE)])
    rgba = render_in_children(quad, shots_of(light, samples=64))[0].astype(np.float64)
    albedo = srgb_decode(bilinear(texture, random.random((100_000, 2)))[:, :3]).mean()
    centre = rgba[10:14, 16:20, :3].mean() / (LIGHT_POWER_W / (4 * np.pi**2))
    return float(centre), float(albedo), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
