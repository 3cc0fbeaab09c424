"""Assets against closed forms, as written and as MuJoCo and USD read them."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from bench.factory.engines import (
    ENGINES,
    drift_of_angular_momentum,
    rest_in_mujoco,
    slide_in_mujoco,
)
from objectfolder.errors import InputError, UnsolvableError
from objectfolder.export.files import Credit
from objectfolder.export.gltf import Part
from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.object_file import ObjectFile
from objectfolder.simulators import collision
from objectfolder.simulators.asset import Asset, Contact, RigidBody
from objectfolder.simulators.collision import convex_parts, measure_parts
from objectfolder.simulators.formats import write_asset
from objectfolder.simulators.parts_product import absent_parts, parts_of, parts_product
from objectfolder.surface.convex_parts import ConvexParts, convex_hull
from objectfolder.surface.surface import Surface
from objectfolder.surface.textured_mesh import textured_mesh_of
from objectfolder.vision.appearance import Appearance
from pipeline.publish.scenes.scene import write_scene
from pipeline.publish.scenes.stable_poses import lay_out, stable_poses, standing, table_side

SIDES = np.array([0.12, 0.08, 0.03])
DENSITY = 2700.0
MASS = DENSITY * float(SIDES.prod())
INERTIA = np.diag(MASS / 12 * ((SIDES**2).sum() - SIDES**2))
CENTRE = np.array([0.01, -0.02, 0.03])


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


def box(sides: np.ndarray = SIDES, centre: np.ndarray = CENTRE) -> Surface:
    mesh = trimesh.creation.box(sides)
    mesh.apply_translation(centre)
    return surface_of(mesh)


def angle(side: float = 0.1, wall: float = 0.03, height: float = 0.05) -> Surface:
    """Return a prism over an L."""
    outline = np.array([(0, 0), (side, 0), (side, wall), (wall, wall), (wall, side), (0, side)])
    caps = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 5), (3, 4, 5)])
    low = np.arange(6)
    high = (low + 1) % 6
    sides = np.concatenate([np.stack([low, high, high + 6], 1), np.stack([low, high + 6, low + 6], 1)])
    vertices = np.concatenate([np.c_[outline, np.zeros(6)], np.c_[outline, np.full(6, height)]])
    return Surface(vertices, np.concatenate([caps[:, ::-1], caps + 6, sides]))


def asset_of(surface: Surface, body: RigidBody, name: str = "block") -> Asset:
    texture = np.zeros((4, 4, 4), np.uint8)
    texture[..., 0] = texture[..., 3] = 255
    flat = np.zeros((len(surface.faces), 3, 2))
    part = Part(surface.vertices[surface.faces], surface.corner_normals, flat, texture)
    looks = Appearance(roughness=0.4, metallic=0.0)
    contact, credit = Contact(0.35, 0.5), Credit(name)
    return Asset(name, [part], surface, looks, convex_parts(surface), body, "solid", contact, credit)


@pytest.fixture(scope="module")
def block() -> Asset:
    return asset_of(box(), RigidBody(MASS, CENTRE, INERTIA))


@pytest.fixture(scope="module")
def folder(block: Asset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("block")
    write_asset(folder, block)
    return folder


def test_a_box_is_one_part_that_covers_it(block: Asset) -> None:
    assert len(block.collision.hulls) == 1
    assert block.collision.union_iou > 0.999
    assert block.collision.outward_m < 1e-6
    assert block.collision.inward_m < 1e-6


def test_an_angle_is_few_parts_that_cover_it() -> None:
    parts = convex_parts(angle(), seed=3)
    assert 2 <= len(parts.hulls) <= 3
    assert parts.union_iou > 0.99
    again = convex_parts(angle(), seed=3)
    assert [hull.vertices.tobytes() for hull in parts.hulls] == [h.vertices.tobytes() for h in again.hulls]


@pytest.mark.slow
def test_hulls_have_few_corners_and_a_ball_stays_round() -> None:
    ball = surface_of(trimesh.creation.icosphere(subdivisions=3, radius=0.05))
    (hull,) = convex_parts(ball).hulls
    assert len(hull.vertices) <= 128
    radii = np.linalg.norm(hull.vertices, axis=1)
    assert np.all((radii > 0.049) & (radii < 0.051))
    rings = surface_of(trimesh.creation.torus(0.05, 0.015, major_sections=16, minor_sections=16))
    parts = convex_parts(rings, threshold_m=0.02, most_parts=8).hulls
    assert len(parts) > 1
    assert max(len(hull.vertices) for hull in parts) <= 32


@pytest.mark.slow
def test_a_surface_that_takes_too_long_has_no_parts_and_its_product_says_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(collision, "COACD_LIMIT_S", 1)
    rings = surface_of(trimesh.creation.torus(0.05, 0.015, major_sections=64, minor_sections=32))
    with pytest.raises(UnsolvableError, match=r"takes more than 1 CPU-s.*one part") as caught:
        convex_parts(rings, threshold_m=1e-4)
    product = absent_parts(caught.value.finding)
    assert len(product["vertices"]) == 0
    with pytest.raises(UnsolvableError, match=r"ring: it has no collision parts.*1 CPU-s.*--most-parts 1"):
        parts_of(product, "ring")


def test_parts_come_back_from_their_product() -> None:
    parts = convex_parts(angle(), seed=3)
    product = parts_product(parts)
    again = parts_of(product, "angle")
    assert again.to_dict() == parts.to_dict()
    for hull, same in zip(parts.hulls, again.hulls, strict=True):
        np.testing.assert_array_equal(hull.vertices, same.vertices)
        np.testing.assert_array_equal(hull.faces, same.faces)


def test_an_object_file_keeps_its_parts(small_file: Path, tmp_path: Path) -> None:
    bar = ObjectFile.load(small_file)
    assert bar.collision is None
    parts = convex_parts(angle(), seed=3)
    bar.with_collision(parts).save(tmp_path / "bar.safetensors")
    again = ObjectFile.load(tmp_path / "bar.safetensors").collision
    assert again is not None
    assert again.to_dict() == parts.to_dict()
    for hull, same in zip(parts.hulls, again.hulls, strict=True):
        np.testing.assert_array_equal(hull.vertices, same.vertices)
        assert hull.area == pytest.approx(same.area, rel=1e-12)


def test_a_finer_threshold_is_tried_until_the_parts_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []
    original = collision._hulls

    def noted(surface, threshold_m, *rest):
        tried.append(threshold_m)
        return original(surface, threshold_m, *rest)

    monkeypatch.setattr(collision, "_hulls", noted)
    monkeypatch.setattr(collision, "THRESHOLD", 0.6)
    assert convex_parts(angle()).union_iou > 0.99
    coarse, *finer = tried
    assert coarse == pytest.approx(0.06)
    assert len(convex_parts(angle(), threshold_m=coarse).hulls) == 1
    assert finer
    assert all(threshold < coarse for threshold in finer)


def test_measures_of_parts_are_those_of_boxes() -> None:
    # A hull that sticks out on one side by 10 mm and stays 20 mm inside on the other.
    hull = box(SIDES - np.array([0.01, 0, 0]), CENTRE + np.array([0.015, 0, 0]))
    measured = measure_parts(box(), (hull,))
    both, either = SIDES[0] - 0.02, SIDES[0] + 0.01
    assert measured.union_iou == pytest.approx(both / either, abs=0.01)
    assert measured.outward_m == pytest.approx(0.01, rel=1e-6)
    assert measured.inward_m == pytest.approx(0.02, rel=1e-6)


@pytest.mark.parametrize(
    ("engine", "kind"), [(engine, kind) for engine, (_, kinds) in ENGINES.items() for kind in kinds]
)
def test_every_engine_reads_mass_centre_and_inertia(
    folder: Path, block: Asset, engine: str, kind: str
) -> None:
    assert ENGINES[engine][0](folder, kind).worst_relative(block.body, 0.12) < 1e-6


def test_the_description_says_what_was_written(folder: Path) -> None:
    described = json.loads((folder / "object.json").read_text())
    assert described["mass_kg"] == MASS
    assert described["collision"]["parts"] == 1
    assert all((folder / name).is_file() for name in described["files"])
    assert {"object.xml", "object.urdf", "model.sdf", "object.usda"} <= set(described["files"])


def test_no_geometry_adds_mass_and_looks_do_not_collide(folder: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(folder / "object.xml"))
    assert model.body_mass.sum() == pytest.approx(MASS, rel=1e-12)
    visual = [at for at in range(model.ngeom) if model.geom(at).group[0] == 2]
    assert visual
    assert all(model.geom_contype[at] == 0 and model.geom_conaffinity[at] == 0 for at in visual)
    assert model.ntex == 1


def test_the_surface_is_one_closed_mesh_that_collides_by_signed_distance(tmp_path: Path) -> None:
    ring = surface_of(trimesh.creation.torus(0.05, 0.015))
    solid = asset_of(box(SIDES, np.zeros(3)), RigidBody(MASS, np.zeros(3), INERTIA))
    write_asset(tmp_path, replace(solid, surface=ring), ("mjcf",))
    assert trimesh.load(tmp_path / "surface.obj").is_watertight
    spec = mujoco.MjSpec.from_file(str(tmp_path / "object.xml"))
    body = spec.worldbody.first_body()
    spec.add_mesh(name="surface", file="surface.obj")
    for geom in body.geoms:
        geom.contype = geom.conaffinity = 0
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SDF, meshname="surface", mass=0)
    # A peg through the ring: hulls would have to leave room for it, the signed distance does.
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0])
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1], pos=[0, 0, -0.0155])
    model = spec.compile()
    data = mujoco.MjData(model)
    while data.time < 1:
        mujoco.mj_step(model, data)
    assert data.qpos[2] == pytest.approx(-0.0005, abs=3e-4)
    assert np.abs(data.qpos[:2]).max() < 1e-3


def test_usd_is_in_metres_with_a_convex_guide_and_the_contact_bound(folder: Path) -> None:
    from pxr import Usd, UsdGeom, UsdPhysics

    stage = Usd.Stage.Open(str(folder / "object.usda"))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    hulls = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.CollisionAPI)]
    assert [UsdPhysics.MeshCollisionAPI(prim).GetApproximationAttr().Get() for prim in hulls] == [
        "convexHull"
    ]
    assert UsdGeom.Imageable(hulls[0]).GetPurposeAttr().Get() == "guide"
    material = UsdPhysics.MaterialAPI(stage.GetPrimAtPath("/object/contact"))
    assert material.GetDynamicFrictionAttr().Get() == pytest.approx(0.35)


def test_a_box_rests_on_three_pairs_of_sides(block: Asset, folder: Path) -> None:
    poses = stable_poses(block, least_probability=0.0)
    assert len(poses) == 6
    assert sum(pose.probability for pose in poses) == pytest.approx(1, abs=1e-6)
    heights = sorted({round(float((pose.object_to_world @ [*CENTRE, 1])[2]), 6) for pose in poses})
    assert heights == pytest.approx(sorted(SIDES / 2))
    # The flattest pose is the most probable.
    assert (poses[0].object_to_world @ [*CENTRE, 1])[2] == pytest.approx(SIDES[2] / 2)
    rest = rest_in_mujoco(folder, poses[0].object_to_world)
    assert rest.moved_m < 2e-4
    assert rest.tilted_deg < 0.1
    assert rest.speed < 1e-3
    assert rest.overlap_m < 2e-4


def test_a_box_slides_where_the_slope_exceeds_its_friction(block: Asset, folder: Path) -> None:
    flat = stable_poses(block)[0].object_to_world
    assert slide_in_mujoco(folder, flat, 0.35) == pytest.approx(1, abs=0.05)


def test_a_spinning_box_keeps_its_angular_momentum(folder: Path) -> None:
    assert drift_of_angular_momentum(folder) < 1e-3


def test_a_measured_mass_scales_the_inertia(block: Asset) -> None:
    heavier = block.body.of_mass(2 * MASS)
    np.testing.assert_allclose(heavier.inertia_kg_m2, 2 * INERTIA)


def test_the_apex_of_a_cone_from_a_gltf_points_up_in_mujoco(tmp_path: Path) -> None:
    """Its y is up by the standard, and z is for a simulator: of what is seen and of what collides."""
    radius, height = 0.03, 0.12
    cone = trimesh.creation.cone(radius, height, sections=16)
    cone.vertices = cone.vertices[:, [0, 2, 1]] * [1, 1, -1]
    cone.export(tmp_path / "cone.glb")
    surface = textured_mesh_of(ingest_object(tmp_path / "cone.glb")).surface
    body = RigidBody(MASS, np.array([0, 0, height / 4]), INERTIA)
    write_asset(tmp_path, asset_of(surface, body, "cone"), ("mjcf",))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "object.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    meshes = [geom for geom in range(model.ngeom) if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH]
    assert len(meshes) == 2
    for geom in meshes:
        first, count = (int(of[model.geom_dataid[geom]]) for of in (model.mesh_vertadr, model.mesh_vertnum))
        turn = data.geom_xmat[geom].reshape(3, 3)
        points = data.geom_xpos[geom] + model.mesh_vert[first : first + count] @ turn.T
        np.testing.assert_allclose(points[np.argmax(points[:, 2])], [0, 0, height], atol=1e-6)
        assert np.linalg.norm(points[points[:, 2] < 1e-6, :2], axis=1).max() == pytest.approx(radius)


@given(st.floats(0.01, 10), st.integers(0, 2**31))
def test_principal_moments_and_axes_give_the_inertia_back(scale: float, seed: int) -> None:
    turn = trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))[:3, :3]
    inertia = scale * turn @ INERTIA @ turn.T
    inertia = (inertia + inertia.T) / 2
    moments, axes = RigidBody(MASS, CENTRE, inertia).principal()
    assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, inertia, rtol=1e-9, atol=1e-12 * scale)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: RigidBody(0.0, CENTRE, INERTIA), "a mass of 0 kg"),
        (lambda: RigidBody(float("nan"), CENTRE, INERTIA), "not finite"),
        (lambda: RigidBody(1.0, CENTRE, np.diag([1.0, 1.0, 3.0])), "no body's"),
        (lambda: RigidBody(1.0, CENTRE, -INERTIA), "no body's"),
        (lambda: RigidBody(1.0, CENTRE[:2], INERTIA), "not finite"),
        (lambda: Contact(-0.1, 0.5), "friction -0.1"),
        (lambda: Contact(0.1, 1.5), "restitution 1.5"),
        (lambda: convex_parts(box(), most_parts=0), "0 collision parts"),
        (lambda: convex_parts(box(), threshold_m=-1.0), "a threshold of -1"),
    ],
    ids=["no mass", "nan", "triangle", "negative", "shape", "friction", "restitution", "parts", "threshold"],
)
def test_what_no_body_has_is_refused(make: Callable[[], object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        make()


@pytest.mark.parametrize("suffix", [".xml", ".usda"])
def test_a_scene_holds_its_objects_at_rest_and_apart(block: Asset, tmp_path: Path, suffix: str) -> None:
    twin = replace(block, name="other")
    for asset in (block, twin):
        (tmp_path / asset.name).mkdir()
        write_asset(tmp_path / asset.name, asset, ("mjcf", "usd"))
    assets = [block, twin, block]
    poses = lay_out(assets, 0.6, height_m=0.7, seed=5)
    path = tmp_path / f"scene{suffix}"
    write_scene(path, [asset.name for asset in assets], poses, 0.6, height_m=0.7)
    if suffix == ".usda":
        from pxr import Usd, UsdPhysics

        stage = Usd.Stage.Open(str(path))
        bodies = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
        assert len(bodies) == 3
        return
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert all(contact.dist > -1e-6 for contact in data.contact)
    before = data.qpos.copy()
    while data.time < 1:
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.qpos, before, atol=1e-3)
    assert np.abs(data.qvel).max() < 1e-3


def test_objects_stand_upright_and_close_together_on_a_table_of_their_size(block: Asset) -> None:
    poses = lay_out([block] * 5, seed=2, upright=True)
    corners = [hull.vertices for hull in block.collision.hulls]
    placed = [np.concatenate(corners) @ pose[:3, :3].T + pose[:3, 3] for pose in poses]
    for pose, points in zip(poses, placed, strict=True):
        np.testing.assert_array_equal(pose[2, :3], [0.0, 0.0, 1.0])
        assert points[:, 2].min() == pytest.approx(0.0, abs=1e-12)
    radius = max(
        np.linalg.norm(points[:, :2] - points[:, :2].mean(axis=0), axis=1).max() for points in placed
    )
    places = np.array([points[:, :2].mean(axis=0) for points in placed])
    apart = np.linalg.norm(places[:, None] - places, axis=2)[np.triu_indices(5, 1)]
    assert apart.min() > 2 * radius
    assert apart.max() < 8 * radius, "in a row they would be 8 radii long"
    side_m = table_side([block] * 5, poses)
    assert all((np.abs(points[:, :2]) < side_m / 2).all() for points in placed)
    assert side_m < 3.0 * np.abs(np.concatenate(placed)[:, :2]).max()


def test_what_would_fall_over_rests_in_its_most_probable_pose(block: Asset) -> None:
    assert standing(block) is not None
    leaning = replace(block, body=replace(block.body, centre_of_mass_m=np.array([10.0, 0.0, 0.0])))
    assert standing(leaning) is None
    with pytest.raises(InputError, match="centre of mass is not within"):
        lay_out([leaning], seed=0)
    (pose,) = lay_out([block], seed=0, upright=True)
    body = replace(block.body, centre_of_mass_m=np.array([0.0, 0.0, 0.0125]))
    on_its_tip = replace(block, body=body, collision=ConvexParts((cone(),), 1.0, 0.0, 0.0))
    (lying,) = lay_out([on_its_tip], seed=0, upright=True)
    assert pose[2, 2] == 1.0
    assert lying[2, 2] < 0.99


def cone() -> Surface:
    """A cone that stands on its tip."""
    mesh = trimesh.creation.cone(0.02, 0.05)
    hull = convex_hull(mesh.vertices * [1.0, 1.0, -1.0] + [0.0, 0.0, 0.025])
    assert hull is not None
    return hull


def test_the_same_seed_lays_out_alike_and_a_small_table_is_refused(block: Asset) -> None:
    first, second = lay_out([block] * 3, 0.6, seed=1), lay_out([block] * 3, 0.6, seed=1)
    np.testing.assert_array_equal(first, second)
    with pytest.raises(InputError, match=r"no room on a table of 0\.15 m"):
        lay_out([block] * 3, 0.15, seed=1)
    with pytest.raises(InputError, match="names no format of scenes"):
        write_scene(Path("scene.obj"), [], [], 1.0)
