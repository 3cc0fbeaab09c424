"""Solids of surfaces as they come: what the mesher, its checks and its other ways make of hard cases."""

import subprocess
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh
from structured_solids import box

from objectfolder.errors import InputError, SimulationError, UnsolvableError
from objectfolder.making.solid import filling, thickening
from objectfolder.making.solid.filling import Filling, fill
from objectfolder.making.solid.solid import Solid
from objectfolder.making.solid.tetwild import CutOffError, Envelope, run_tetwild
from objectfolder.surface.connectivity import edge_table
from objectfolder.surface.signed_distance import surface_at_depth
from objectfolder.surface.surface import Surface

BOX = trimesh.creation.box((1.0, 1.0, 1.0))


def block(sides: tuple[float, float, float], at: tuple[float, float, float] = (0, 0, 0)) -> Any:
    """Vertices and faces of a box about a point."""
    return np.asarray(BOX.vertices) * sides + at, np.asarray(BOX.faces)


def joined(*parts: Any) -> Surface:
    """One surface of several, vertices at equal places shared."""
    starts = np.cumsum([0, *[len(vertices) for vertices, _ in parts]])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    faces = np.concatenate([faces + start for (_, faces), start in zip(parts, starts[:-1], strict=True)])
    distinct, number = np.unique(vertices.round(12), axis=0, return_inverse=True)
    return Surface(distinct, number.reshape(-1)[faces])


def sound(solid: Solid) -> None:
    """What holds for every solid."""
    corner = solid.vertices[solid.tetrahedra]
    assert np.linalg.det(corner[:, 1:] - corner[:, :1]).min() > 0
    assert solid.report["bodies"] == solid.components
    assert solid.target is not None
    points = solid.target.sample(500, 5).points
    away = Surface(solid.vertices, solid.boundary()[0]).closest_points(points).distance
    # Both are the largest of a sample; rays and distances are good to single precision.
    negligible = 1e-6 * float(np.ptp(solid.vertices, axis=0).max())
    assert away.max() <= 1.5 * solid.report["surface_error_max_m"] + negligible


RELEASE = pytest.mark.release("objectfolder.making.solid")


@pytest.fixture
def coarse_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    """Find surfaces at a depth on a tenth of the nodes: they have a quarter of the triangles."""

    def coarse(surface: Surface, depth: float, nodes: int = 200_000) -> Surface | None:
        return surface_at_depth(surface, depth, nodes=nodes // 10)

    monkeypatch.setattr(filling, "surface_at_depth", coarse)
    monkeypatch.setattr(thickening, "surface_at_depth", coarse)


def bumpy() -> Any:
    """A closed surface of 80 triangles without symmetry."""
    sphere = trimesh.creation.icosphere(1, 0.1)
    x = np.asarray(sphere.vertices)
    return x * [1, 0.7, 0.5] * (1 + 0.2 * np.sin(40 * x[:, 1:2])), np.asarray(sphere.faces)


@cache
def filled() -> Solid:
    return fill(Surface(*bumpy()))


@pytest.mark.slow
def test_size_place_and_order_change_nothing() -> None:
    (vertices, faces), solid = bumpy(), filled()
    sound(solid)
    random = np.random.default_rng(3)
    place = random.permutation(len(vertices))
    shuffled = np.empty_like(vertices)
    shuffled[place] = vertices
    shuffled_solid = fill(
        Surface(1000 * (shuffled + np.array([3, -2, 1])), place[faces][random.permutation(len(faces))])
    )
    np.testing.assert_array_equal(shuffled_solid.tetrahedra, solid.tetrahedra)
    back = shuffled_solid.vertices / 1000 - [3, -2, 1]
    np.testing.assert_allclose(back, solid.vertices, atol=1e-6 * np.ptp(vertices))
    assert shuffled_solid.volume_m3 == pytest.approx(1e9 * solid.volume_m3, rel=1e-6)


@RELEASE
def test_a_turned_object_has_another_solid_as_good() -> None:
    vertices, faces = bumpy()
    turn = trimesh.transformations.rotation_matrix(1.0, [1, 2, 3])[:3, :3]
    solid, turned = filled(), fill(Surface(vertices @ turn.T, faces))
    sound(turned)
    assert turned.volume_m3 == pytest.approx(solid.volume_m3, rel=0.02)
    assert len(turned.tetrahedra) == pytest.approx(len(solid.tetrahedra), rel=0.3)


@pytest.mark.slow
def test_bodies_that_touch_along_an_edge_or_nearly_touch_stay_apart() -> None:
    """Two cubes share an edge, which four faces meet at; 5 mm beside the second is half a cube."""
    second, third = block((0.1, 0.1, 0.1), (0.1, 0.1, 0)), block((0.05, 0.1, 0.1), (0.18, 0.1, 0))
    solid = fill(joined(block((0.1, 0.1, 0.1)), second, third))
    sound(solid)
    assert solid.components == 3
    assert sorted(solid.report["body_volume_shares"]) == pytest.approx([0.2, 0.4, 0.4], rel=0.01)
    assert solid.volume_m3 == pytest.approx(0.0025, rel=1e-3)
    assert solid.report["doubts"] == []


@pytest.mark.slow
def test_a_non_manifold_sheet_inside_changes_nothing() -> None:
    """A wall across a box: three faces at each of its edges."""
    vertices, faces = block((0.05, 0.04, 0.04), (0.025, 0, 0))
    surface = joined((vertices, faces), (vertices * [-1, 1, 1], faces[:, ::-1]))
    _, first = np.unique(np.sort(surface.faces, axis=1), axis=0, return_index=True)
    surface = Surface(surface.vertices, surface.faces[first])
    assert edge_table(surface.faces).face_count.max() == 3
    solid = fill(surface)
    sound(solid)
    assert solid.components == 1
    assert solid.volume_m3 == pytest.approx(0.1 * 0.04 * 0.04, rel=0.01)


@RELEASE
def test_needles_do_not_hurt() -> None:
    """A box one of whose faces is a fan of 101 triangles, some 300 times longer than wide."""
    vertices, faces = block((0.1, 0.03, 0.02))
    top = faces[(vertices[faces][:, :, 2] > 0).all(axis=1)]
    corner = top[0]
    row = np.linspace(vertices[corner[1]], vertices[corner[2]], 102)[1:-1]
    extra = len(vertices) + np.arange(100)
    ends = np.concatenate([[corner[1]], extra, [corner[2]]])
    fan = np.stack([np.full(101, corner[0]), ends[:-1], ends[1:]], axis=1)
    rest = faces[~(faces == corner).all(axis=1)]
    # The other face at that edge keeps its straight side: the needles' ends are T-junctions, as scans have.
    surface = Surface(np.concatenate([vertices, row]), np.concatenate([rest, fan]))
    solid = fill(surface)
    sound(solid)
    assert solid.components == 1
    assert solid.volume_m3 == pytest.approx(0.1 * 0.03 * 0.02, rel=0.01)


@pytest.mark.slow
def test_patches_turned_inside_out_are_turned_back() -> None:
    vertices, faces = block((0.1, 0.02, 0.01))
    faces = np.concatenate([faces[:5, ::-1], faces[5:]])
    solid = fill(Surface(vertices, faces))
    sound(solid)
    assert solid.volume_m3 == pytest.approx(2e-5, rel=0.01)
    assert solid.report["doubts"] == []


@pytest.mark.slow
def test_an_open_box_is_filled() -> None:
    vertices, faces = block((0.1, 0.02, 0.01))
    solid = fill(Surface(vertices, faces[:-2]))
    assert solid.volume_m3 == pytest.approx(2e-5, rel=0.02)
    assert solid.report["volume_uncertainty"] > 0
    assert solid.report["closing_share"] == pytest.approx(2e-4 / 6.4e-3, rel=0.1)


@RELEASE
def test_a_strip_500_times_as_long_as_thick() -> None:
    solid = fill(Surface(*block((1.0, 0.1, 0.002))))
    sound(solid)
    assert solid.volume_m3 == pytest.approx(0.0002, rel=0.01)
    assert solid.components == 1
    assert len(solid.tetrahedra) < 2200
    assert solid.report["wall_median_ratio"] == pytest.approx(1, rel=0.01)


@RELEASE
def test_40_000_triangles() -> None:
    torus = trimesh.creation.torus(0.08, 0.02, major_sections=200, minor_sections=100)
    assert len(torus.faces) == 40_000
    solid = fill(Surface(torus.vertices, torus.faces))
    sound(solid)
    assert solid.volume_m3 == pytest.approx(torus.volume, rel=0.06)
    assert len(solid.tetrahedra) < 2200


def test_a_stated_wall_and_a_shell_exclude_each_other() -> None:
    with pytest.raises(InputError, match=r"can: has both wall_m and shell_m\. State one"):
        fill(Surface(*block((1, 1, 1))), wall_m=0.1, shell_m=0.1, name="can")


@pytest.mark.slow
def test_a_stated_wall_is_filled() -> None:
    surface = Surface(*block((0.1, 0.08, 0.001)))
    solid = fill(surface, wall_m=0.003)
    sound(solid)
    assert solid.report["wall_m"] == 0.003
    assert solid.report["wall_area_share"] > 0.9
    assert solid.volume_m3 == pytest.approx(0.102 * 0.082 * 0.003, rel=0.02)


@pytest.mark.usefixtures("coarse_grid")
@pytest.mark.slow
def test_a_closed_box_with_a_shell_is_hollow() -> None:
    solid = fill(Surface(*block((0.1, 0.08, 0.06))), shell_m=0.01)
    sound(solid)
    assert solid.components == 1
    assert solid.report["wall_median_ratio"] == pytest.approx(1, rel=0.1)
    assert solid.report["doubts"] == []
    truth = 0.1 * 0.08 * 0.06 - 0.08 * 0.06 * 0.04
    assert solid.volume_m3 / (1 + solid.report["volume_error"]) == pytest.approx(truth, rel=0.01)
    assert solid.volume_m3 == pytest.approx(truth, rel=0.06)


@pytest.mark.usefixtures("coarse_grid")
@pytest.mark.slow
def test_out_of_time_no_solid_is_made_up() -> None:
    sphere = trimesh.creation.icosphere(3)
    with pytest.raises(SimulationError, match="fTetWild took more than 1 CPU-s") as slow:
        fill(Surface(sphere.vertices, sphere.faces), Filling(time_limit_s=1, target_faces=20_000))
    # A slower machine made it so: an object must not be told silent for that.
    assert not isinstance(slow.value, UnsolvableError)


@pytest.mark.usefixtures("coarse_grid")
@pytest.mark.slow
def test_where_an_envelope_fails_the_surface_is_remeshed(monkeypatch: pytest.MonkeyPatch) -> None:
    run, limits = filling.run_tetwild, []

    def fails_twice(surface: Surface, envelope: Envelope) -> Any:
        limits.append(envelope.time_limit_s)
        return run(surface, envelope) if len(limits) > 2 else "fTetWild failed"

    monkeypatch.setattr(filling, "run_tetwild", fails_twice)
    solid = fill(Surface(*block((0.1, 0.08, 0.06))))
    sound(solid)
    assert solid.report["way"] == "remeshed"
    assert [entry.get("failed") for entry in solid.report["tried"]] == ["fTetWild failed"] * 2 + [None]
    assert solid.volume_m3 == pytest.approx(0.1 * 0.08 * 0.06, rel=0.03)
    assert limits == [60, 40, 60]


@pytest.mark.usefixtures("coarse_grid")
@pytest.mark.slow
def test_a_sheet_is_refused_with_a_wall_that_was_tried() -> None:
    sheet = Surface(
        np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    ways = r"envelope: .*; wide envelope: .*; remeshed: it encloses no volume on a grid"
    with pytest.raises(UnsolvableError, match=rf"sheet\.obj: .*{ways}.* 0\.014 m was tried") as refused:
        fill(sheet, name="sheet.obj")
    assert refused.value.remedy.startswith("State wall_m, the thickness of its sheets: 0.014 m")


@pytest.mark.usefixtures("coarse_grid")
def test_a_small_part_of_a_body_is_no_solid_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a grid loses thin boards: what cut off each way is said in order."""
    part, envelopes = box((1, 1, 1), (0.1, 0.1, 0.1)), []

    def cut_off_twice(_: Surface, envelope: Envelope) -> dict[str, Any]:
        envelopes.append(envelope)
        if len(envelopes) < 3:
            raise CutOffError("fTetWild", f"took more than {envelope.time_limit_s:.0f} CPU-s")
        tetrahedra = {"vertices": part.vertices, "tetrahedra": part.tetrahedra}
        return {**tetrahedra, "faces": 12, "moved": 0.0, "edge": 0.1}

    monkeypatch.setattr(filling, "run_tetwild", cut_off_twice)
    reasons = (
        r"envelope: fTetWild took more than 60 CPU-s; wide envelope: .* 40 CPU-s; remeshed: the volume is -"
    )
    with pytest.raises(SimulationError, match=rf"board: .*{reasons}") as refused:
        fill(Surface(*block((1.0, 1.0, 1.0))), name="board")
    assert not isinstance(refused.value, UnsolvableError)


def test_a_kill_from_outside_makes_no_other_solid(monkeypatch: pytest.MonkeyPatch) -> None:
    """The next way to fill would be taken, and its solid kept as that of the first."""
    calls = []

    def killed(*_: object, **__: object) -> subprocess.CompletedProcess[str]:
        calls.append(1)
        return subprocess.run(["sh", "-c", "kill -9 $$"], capture_output=True, text=True, check=False)

    monkeypatch.setattr("objectfolder.making.solid.tetwild.run_module", killed)
    with pytest.raises(SimulationError, match=r"fTetWild: was killed from outside \(signal 9\)"):
        fill(Surface(*block((1.0, 1.0, 1.0))), name="board")
    assert len(calls) == 1


@pytest.mark.slow
def test_an_object_of_24_metres() -> None:
    solid = fill(Surface(*block((24.0, 2.0, 1.0))))
    sound(solid)
    assert solid.volume_m3 == pytest.approx(48, rel=0.01)


def spiked() -> Surface:
    """A cube with a spike on its top, in all 1.6 times as high as wide."""
    cube = trimesh.creation.box((1.0, 1.0, 1.0))
    for _ in range(4):
        cube = cube.subdivide()
    vertices = np.asarray(cube.vertices)
    tip = (np.abs(vertices[:, :2]).max(axis=1) < 0.1) & (vertices[:, 2] > 0.49)
    return Surface(vertices + np.where(tip[:, None], [0.0, 0.0, 0.6], 0.0), np.asarray(cube.faces))


@pytest.mark.usefixtures("coarse_grid")
@pytest.mark.parametrize(
    ("surface", "height", "doubt"),
    [
        (spiked(), 1 / 1.6, "of the surface is farther from it than its wall is thick"),
        # Both face outward, so that the inner one is no hole.
        (joined(block((0.1, 0.08, 0.06)), block((0.08, 0.06, 0.04))), 1.0, "its median wall is"),
    ],
    ids=["a spike", "an inner box"],
)
def test_a_solid_that_lacks_a_part_is_doubted(
    surface: Surface, height: float, doubt: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = box((4, 4, 4), (1, 1, 1))

    def block_alone(surface: Surface, _: Envelope) -> dict[str, Any]:
        low, sides = surface.vertices.min(axis=0), np.ptp(surface.vertices, axis=0)
        placed = low + sides * (1, 1, height) * (part.vertices - part.vertices.min(axis=0))
        return {"vertices": placed, "tetrahedra": part.tetrahedra, "faces": 12, "moved": 0.0, "edge": 0.1}

    monkeypatch.setattr(filling, "run_tetwild", block_alone)
    (said,) = fill(surface).report["doubts"]
    assert doubt in said


@pytest.mark.slow
def test_what_takes_too_much_memory_is_said() -> None:
    """Three hundred triangles at random reach the limit within seconds."""
    triangles = Surface(np.random.default_rng(0).random((900, 3)) / 2, np.arange(900).reshape(-1, 3))
    with pytest.raises(CutOffError, match=r"fTetWild: needs more than 0\.3 GB"):
        run_tetwild(triangles, Envelope(1e-3, 1e-3, 0.2, 0.2, 800, 1600, 40.0, 20.0, 3e8))
