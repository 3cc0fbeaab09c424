"""Walls that cannot be the object's: what is found on bodies whose walls are known, and on scans."""

import json

import numpy as np
import pytest
import trimesh
from revolved_shapes import SECTORS, ball, bottle, can, cup, raised, revolved, with_cavity
from small_meshes import cube

from objectfolder.mesh.walls.container_shape import container_shape, sections
from objectfolder.mesh.walls.mass_evidence import shell_of_mass
from objectfolder.mesh.walls.vessels import (
    CERTAIN,
    FILLED_BELOW,
    HEAVIER,
    LIGHTER,
    LIKELY,
    ONE_LAYER,
    POSSIBLE,
    SCANNED_SOLID,
    THIN,
    TORN,
    wall_findings,
)
from objectfolder.mesh.walls.wall_measures import LEVELS, WallMeasures, measure_walls
from objectfolder.mesh.walls.walls_of_materials import WALL_LIMITS
from objectfolder.solid.shell import hollow
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import enclosed_volume

# A circle of SECTORS chords, against a true circle.
CHORDS = SECTORS / (2 * np.pi) * np.sin(2 * np.pi / SECTORS)


def kinds(measures: WallMeasures, **known: object) -> list[tuple[str, str]]:
    return [(finding.kind, finding.certainty) for finding in wall_findings(measures, **known)]


def test_a_shell_of_known_thickness_is_measured():
    hollow_ball = with_cavity(revolved(ball(0.05)), revolved(ball(0.047)))
    measures = measure_walls(hollow_ball, cavities=1)
    assert measures.closed
    assert measures.wall_share == 1.0
    assert measures.usual_wall_m() == pytest.approx(0.003, rel=0.02)
    assert measures.wall_m[LEVELS.index(0.05)] == pytest.approx(0.003, rel=0.03)
    assert measures.bulk_m == pytest.approx(0.003, rel=0.05)
    assert measures.walls_thinner_than(0.0031) == 1.0
    assert measures.walls_thinner_than(0.0028) == 0.0
    assert measures.torn_share == measures.overlapping_share == 0.0
    assert kinds(measures, material="ceramic", density_kg_m3=2700, words="jar") == []


def test_sections_of_a_can_are_its_circles():
    body = revolved(can(0.05, 0.14))
    across = sections(Surface(body.vertices + np.array([0.3, 0, 7.0]), body.faces), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(across.area, np.pi * 0.05**2 * CHORDS, rtol=1e-9)
    np.testing.assert_allclose(across.hull, across.area, rtol=1e-9)
    np.testing.assert_allclose(across.perimeter, 2 * SECTORS * 0.05 * np.sin(np.pi / SECTORS), rtol=1e-9)
    np.testing.assert_allclose(across.middle, np.broadcast_to([0.3, 0, 0], (64, 3)), atol=1e-9)


def test_sections_leave_out_what_is_hollow():
    across = sections(revolved(cup(0.004)), np.array([0.0, 0.0, 1.0]), 90)
    area = across.area
    ring = np.pi * (0.04**2 - 0.036**2) * CHORDS
    np.testing.assert_allclose(area[10:], ring, rtol=1e-9)
    np.testing.assert_allclose(area[:3], np.pi * 0.04**2 * CHORDS, rtol=1e-9)
    np.testing.assert_allclose(across.hull[-3:], np.pi * 0.04**2 * CHORDS, rtol=1e-9)


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize(("outline", "kind"), [(can(), "can"), (bottle(), "bottle"), (ball(), "none")])
def test_shapes_of_containers(outline, kind, turn):
    body = revolved(outline)
    matrix = trimesh.transformations.rotation_matrix(turn, [0.3, 0.9, 0.1])[:3, :3]
    shape = container_shape(Surface(body.vertices @ matrix.T, body.faces))
    assert shape.kind == kind
    if kind != "none":
        assert np.dot(shape.axis, matrix[:, 2]) == pytest.approx(1.0, abs=1e-6) or kind == "can"
        assert shape.roundness > 0.99


def test_a_can_may_have_deep_ends():
    recessed = [
        (0, 0.006),
        (0.04, 0.006),
        (0.041, 0),
        (0.042, 0),
        (0.042, 0.033),
        (0.041, 0.033),
        (0.04, 0.028),
        (0, 0.028),
    ]
    assert container_shape(revolved(recessed)).kind == "can"


def test_bent_bodies_beads_and_flat_bonnets_are_no_containers():
    bottle_of = revolved(bottle())
    bent = bottle_of.vertices.copy()
    bent[:, 0] += 8 * (bent[:, 2] - 0.05) ** 2
    assert container_shape(Surface(bent, bottle_of.faces)).kind == "none"
    assert container_shape(revolved(can(0.008, 0.02))).kind == "none"
    body = trimesh.creation.cylinder(0.03, 0.1)
    flat, round_one = trimesh.creation.box((0.05, 0.012, 0.03)), trimesh.creation.cylinder(0.014, 0.03)
    for top, kind in ((flat, "none"), (round_one, "bottle")):
        top.apply_translation((0, 0, 0.065))
        both = trimesh.util.concatenate([body, top])
        assert container_shape(Surface(np.asarray(both.vertices), np.asarray(both.faces))).kind == kind


def test_gaps_between_pieces_have_no_section():
    stack = [revolved(raised(can(0.03, 0.02), level)) for level in (0.0, 0.05)]
    both = Surface(
        np.concatenate([body.vertices for body in stack]),
        np.concatenate([stack[0].faces, stack[1].faces + len(stack[0].vertices)]),
    )
    across = sections(both, np.array([0.0, 0.0, 1.0]))
    assert (across.area == 0).sum() == (across.perimeter == 0).sum() > 20
    assert container_shape(both).kind == "none"


@pytest.mark.parametrize(
    "extents", [(0.06, 0.06, 0.06), (0.2, 0.08, 0.08), (0.3, 0.2, 0.02)], ids=["cube", "block", "board"]
)
def test_blocks_are_no_containers(extents):
    box = trimesh.creation.box(extents)
    assert container_shape(Surface(np.asarray(box.vertices), np.asarray(box.faces))).kind == "none"


def test_a_can_scanned_solid_is_surer_the_more_is_known():
    measures = measure_walls(revolved(can()))
    assert kinds(measures) == [(SCANNED_SOLID, POSSIBLE)]
    assert kinds(measures, words="soup can") == [(SCANNED_SOLID, LIKELY)]
    assert kinds(measures, material="steel") == [(SCANNED_SOLID, LIKELY)]
    assert kinds(measures, material="steel", density_kg_m3=7850, mass_kg=0.15) == [(SCANNED_SOLID, CERTAIN)]
    assert kinds(measures, material="wood", words="turned block") == []
    assert kinds(measures, material="steel", shell_m=0.001) == []


def test_the_suggested_shell_has_the_published_mass():
    body = revolved(ball(0.04))
    measures = measure_walls(body)
    true = with_cavity(body, revolved(ball(0.037)))
    mass = 1070 * enclosed_volume(true)[0]
    (finding,) = wall_findings(measures, material="plastic", density_kg_m3=1070, mass_kg=mass)
    assert (finding.kind, finding.column) == (SCANNED_SOLID, "shell_m")
    assert finding.suggested_m == pytest.approx(0.003, rel=0.02)
    assert 0 < finding.uncertainty_m < 0.002
    made = hollow(body, finding.suggested_m, nodes=60_000)
    assert enclosed_volume(made)[0] * 1070 == pytest.approx(mass, rel=0.05)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.9])
def test_shell_of_mass_is_exact_for_bodies_around_a_ball(share):
    radius = 0.03
    thickness = radius * (1 - (1 - share) ** (1 / 3))
    for volume, area in (
        (4 / 3 * np.pi * radius**3, 4 * np.pi * radius**2),
        (8 * radius**3, 24 * radius**2),
        (2 * np.pi * radius**3, 6 * np.pi * radius**2),
    ):
        assert shell_of_mass(volume, area, 5.0, 5.0 * share) == pytest.approx(thickness)


def test_shell_of_mass_of_a_tall_can():
    radius, height, wall = 0.05, 0.2, 0.002
    volume, area = np.pi * radius**2 * height, 2 * np.pi * radius * (radius + height)
    shell = volume - np.pi * (radius - wall) ** 2 * (height - 2 * wall)
    assert shell_of_mass(volume, area, volume, shell) == pytest.approx(wall, rel=0.01)


def test_a_lid_closed_over_a_hollow_is_right_as_it_is():
    capped = with_cavity(revolved(can(0.05, 0.14)), revolved(raised(can(0.047, 0.134), 0.003)))
    measures = measure_walls(capped, cavities=1)
    assert kinds(measures) == []
    assert kinds(measures, material="ceramic", words="teapot with lid") == []


def test_open_cups_by_their_material():
    assert kinds(measure_walls(revolved(cup(0.004))), material="ceramic", words="coffee cup") == []
    thin = measure_walls(revolved(cup(0.0006)))
    assert kinds(thin, material="steel") == []
    (finding,) = wall_findings(thin, material="ceramic")
    assert (finding.kind, finding.certainty, finding.column) == (THIN, LIKELY, "wall_m")
    assert finding.suggested_m == WALL_LIMITS["ceramic"].usual_wall_m
    assert finding.evidence["wall_m"] == pytest.approx(0.0006, rel=0.02)
    assert "0.6 mm" in finding.finding
    assert kinds(thin, material="ceramic", wall_m=0.003) == []
    assert kinds(measure_walls(revolved(cup(0.0001)))) == [(THIN, POSSIBLE)]


def test_walls_partly_fused_are_brought_to_the_others_thickness():
    outline = [
        (0, 0), (0.04, 0), (0.04, 0.03), (0.04, 0.09), (0.036, 0.09), (0.036, 0.032), (0.0399, 0.03),
        (0.0399, 0.004), (0, 0.004),
    ]  # fmt: skip
    (finding,) = wall_findings(measure_walls(revolved(outline)), material="ceramic")
    assert finding.kind == THIN
    assert finding.suggested_m == pytest.approx(0.004, rel=0.1)


def test_walls_that_passed_through_one_another_are_torn():
    outline = [
        (0, 0), (0.04, 0), (0.04, 0.03), (0.04, 0.09), (0.037, 0.09), (0.037, 0.062), (0.041, 0.06),
        (0.041, 0.04), (0.037, 0.038), (0.037, 0.004), (0, 0.004),
    ]  # fmt: skip
    measures = measure_walls(revolved(outline))
    # Both sides of a fifth of the height, of walls that are most of the cup.
    assert 0.05 < measures.torn_share < 0.25
    assert (TORN, CERTAIN) in kinds(measures)
    assert (TORN, CERTAIN) in kinds(measures, material="ceramic", shell_m=0.003)


def test_a_mug_filled_from_below_takes_its_name():
    measures = measure_walls(revolved(cup(0.002, base=0.045)))
    assert FILLED_BELOW not in [kind for kind, _ in kinds(measures)]
    (finding,) = wall_findings(measures, material="ceramic", words="blue mug")
    assert (finding.kind, finding.certainty, finding.column) == (FILLED_BELOW, LIKELY, "shell_m")
    assert finding.suggested_m == pytest.approx(0.002, rel=0.05)
    known = {"material": "steel", "density_kg_m3": 7850, "mass_kg": 0.2}
    assert kinds(measures, words="mug", **known) == [(FILLED_BELOW, CERTAIN)]
    assert kinds(measures, words="thing", **known) == [(HEAVIER, CERTAIN)]


def test_handles_and_feet_are_no_filling():
    thick_foot = measure_walls(revolved(cup(0.004, base=0.012)))
    assert kinds(thick_foot, material="ceramic", words="mug") == []


def test_a_mass_that_agrees_silences_hints_alone():
    measures = measure_walls(revolved(ball(0.02)))
    known = {"material": "plastic", "density_kg_m3": 1070.0}
    solid = 1070 * measures.volume_m3
    assert kinds(measures, **known) == [(SCANNED_SOLID, POSSIBLE)]
    assert kinds(measures, **known, mass_kg=1.1 * solid) == []
    # What a bottle holds may weigh as much as the plastic that is not there.
    full = measure_walls(revolved(bottle()))
    known["mass_kg"] = 1070 * full.volume_m3
    assert kinds(full, words="bottle", **known) == [(SCANNED_SOLID, LIKELY)]


def open_box(side: float, wall: float | None) -> Surface:
    """A cube without its upper face: of one layer, or of boards of a thickness that lack it, too."""
    body = cube(side)
    up = body.surface.face_normals[:, 2] > 0.5
    faces = body.faces[~up]
    if wall is None:
        return Surface(body.vertices, faces)
    vertices = body.vertices * (1 - 2 * wall / side)
    vertices[:, 2] = np.where(body.vertices[:, 2] > 0, side / 2, -side / 2 + wall)
    return Surface(
        np.concatenate([body.vertices, vertices]),
        np.concatenate([faces, faces[:, ::-1] + len(body.vertices)]),
    )


def test_a_box_of_one_layer_is_told_from_one_of_boards():
    (finding,) = wall_findings(measure_walls(open_box(0.4, None)), material="plastic")
    assert (finding.kind, finding.certainty, finding.column) == (ONE_LAYER, LIKELY, "shell_m")
    assert finding.evidence["boundary_edges"] == 4
    assert finding.suggested_m == WALL_LIMITS["plastic"].usual_wall_m
    assert kinds(measure_walls(open_box(0.4, None))) == [(ONE_LAYER, LIKELY)]
    assert kinds(measure_walls(open_box(0.4, 0.01)), material="plastic") == []
    assert kinds(measure_walls(open_box(0.4, None)), material="plastic", shell_m=0.003) == []


def test_a_closed_box_takes_what_is_known_of_it():
    measures = measure_walls(cube(0.2).surface)
    assert kinds(measures, material="wood", words="block") == []
    assert kinds(measures, material="ceramic") == [(SCANNED_SOLID, LIKELY)]
    assert kinds(measures, material="plastic", words="LunchBox") == [(SCANNED_SOLID, LIKELY)]


def test_a_ball_is_a_marble_or_a_hollow_fruit():
    marble = measure_walls(revolved(ball(0.0175)))
    assert kinds(marble, material="glass", density_kg_m3=2600, mass_kg=0.058, words="marble") == []
    apple = measure_walls(revolved(ball(0.037)))
    assert kinds(apple, material="plastic", words="apple") == [(SCANNED_SOLID, POSSIBLE)]
    known = {"material": "plastic", "density_kg_m3": 1070, "mass_kg": 0.068, "words": "apple"}
    assert kinds(apple, **known) == [(SCANNED_SOLID, CERTAIN)]


@pytest.mark.parametrize(("mass", "kind"), [(0.02, HEAVIER), (0.2, LIGHTER)])
def test_a_mass_alone_contradicts_a_scan(mass, kind):
    bar = trimesh.creation.box((0.2, 0.01, 0.005))
    measures = measure_walls(Surface(np.asarray(bar.vertices), np.asarray(bar.faces)))
    (finding,) = wall_findings(measures, material="steel", density_kg_m3=7850, mass_kg=mass)
    assert (finding.kind, finding.certainty, finding.column) == (kind, CERTAIN, None)
    assert finding.evidence["fitting_density_kg_m3"] == pytest.approx(mass / 1e-5)
    assert kinds(measures, material="steel", density_kg_m3=7850, mass_kg=0.0785) == []


def test_words_are_whole_words():
    measures = measure_walls(revolved(ball(0.02)))
    assert kinds(measures, material="plastic", words="African_Figure pottery") == [(SCANNED_SOLID, POSSIBLE)]
    assert kinds(measures, material="plastic", words="cans") == [(SCANNED_SOLID, LIKELY)]


def test_measures_survive_json():
    for surface in (revolved(cup(0.003)), open_box(0.3, None)):
        measures = measure_walls(surface)
        assert WallMeasures.from_dict(json.loads(json.dumps(measures.to_dict()))) == measures


def test_shells_that_may_not_be_resolved_are_said_to_be_so():
    steel, ceramic = (
        wall_findings(measure_walls(revolved(can())), material=material)[0]
        for material in ("steel", "ceramic")
    )
    assert "1/560 of its length" in steel.remedy
    assert "resolved" not in ceramic.remedy
    assert "1/200" in wall_findings(measure_walls(open_box(0.4, None)), material="plastic")[0].remedy


def test_findings_say_numbers_units_and_remedy():
    measures = measure_walls(revolved(can()))
    known = {"material": "steel", "density_kg_m3": 7850.0, "mass_kg": 0.349, "words": "soup can"}
    (finding,) = wall_findings(measures, **known)
    text = str(finding)
    for part in ("scanned solid (certain)", "8.6 kg", "349 g", "50 mm", "shell_m", "0.25 mm"):
        assert part in text
    assert finding.evidence["published_mass_kg"] == 0.349


def test_flat_and_single_faces_are_measured_without_failing():
    flat = Surface(np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]), np.array([[0, 1, 2]]))
    measures = measure_walls(flat)
    assert (measures.closed, measures.filled_share, measures.shape) == (False, None, None)
    assert measures.across_m == measures.wall_m == ()
    assert kinds(measures, material="ceramic") == []
