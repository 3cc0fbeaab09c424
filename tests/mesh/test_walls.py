"""Walls that cannot be the object's: what is found on bodies whose walls and masses are known."""

import json

import numpy as np
import pytest
from revolved_shapes import ball, can, cup, raised, revolved, with_cavity
from small_meshes import cube

from objectfolder.making.mesh.walls import (
    CERTAIN,
    HEAVIER,
    LIGHTER,
    LIKELY,
    ONE_LAYER,
    POSSIBLE,
    THIN,
    TOO_THICK,
    WallMeasures,
    measure_walls,
    millimetres,
    shell_of_mass,
    wall_findings,
)
from objectfolder.making.solid.thickening import hollow
from objectfolder.surface.surface import Surface
from objectfolder.surface.winding_number import enclosed_volume

STEEL = {"material": "steel", "density_kg_m3": 7850.0}
PLASTIC = {"material": "plastic", "density_kg_m3": 1070.0}


def kinds(measures: WallMeasures, **properties: object) -> list[tuple[str, str]]:
    return [(finding.kind, finding.certainty) for finding in wall_findings(measures, **properties)]


def test_a_shell_of_known_thickness_is_measured():
    measures = measure_walls(with_cavity(revolved(ball(0.05)), revolved(ball(0.047))))
    assert measures.closed
    assert measures.wall_share == 1.0
    assert measures.wall_median_m == pytest.approx(0.003, rel=0.02)
    assert measures.wall_thin_m == pytest.approx(0.003, rel=0.03)
    assert measures.bulk_m == pytest.approx(0.003, rel=0.05)
    assert measures.thickness() == pytest.approx(
        {"effective_m": 0.003, "median_m": 0.003, "thin_m": 0.003}, rel=0.03
    )
    assert kinds(measures, material="ceramic") == []


def test_the_thickest_part_is_the_largest_ball_inside():
    assert measure_walls(revolved(cup(0.004, base=0.045))).bulk_m == pytest.approx(0.045, rel=0.05)
    assert measure_walls(revolved(can(0.05, 0.14))).bulk_m == pytest.approx(0.1, rel=0.01)


def test_a_solid_that_its_material_is_not_made_as_is_surer_the_more_is_known():
    measures = measure_walls(revolved(can()))
    assert kinds(measures, **PLASTIC) == [(TOO_THICK, POSSIBLE)]
    assert kinds(measures, **STEEL) == [(TOO_THICK, LIKELY)]
    assert kinds(measures, **STEEL, mass_kg=0.15) == [(TOO_THICK, CERTAIN)]
    assert kinds(measures, **STEEL, mass_kg=7850 * measures.volume_m3) == []
    assert kinds(measures, material="wood") == []
    assert kinds(measures, **STEEL, shell_m=0.001) == []


def test_geometry_alone_finds_what_is_thicker_than_anything_handled():
    assert kinds(measure_walls(cube(0.2).surface)) == [(TOO_THICK, POSSIBLE)]
    assert kinds(measure_walls(revolved(can(0.03, 0.14)))) == []


@pytest.mark.slow
def test_the_suggested_shell_has_the_published_mass():
    body = revolved(ball(0.04))
    measures = measure_walls(body)
    mass = 1070 * enclosed_volume(with_cavity(body, revolved(ball(0.037))))[0]
    (finding,) = wall_findings(measures, **PLASTIC, mass_kg=mass)
    assert (finding.kind, finding.column) == (TOO_THICK, "shell_m")
    shell_m = shell_of_mass(measures.volume_m3, measures.area_m2, mass / (1070 * measures.volume_m3))
    assert shell_m == pytest.approx(0.003, rel=0.02)
    assert f"({millimetres(shell_m)} gives the published" in finding.remedy
    assert enclosed_volume(hollow(body, shell_m, nodes=60_000))[0] * 1070 == pytest.approx(mass, rel=0.05)


def test_shell_of_mass_of_a_tall_can():
    radius, height, wall = 0.05, 0.2, 0.002
    volume, area = np.pi * radius**2 * height, 2 * np.pi * radius * (radius + height)
    shell = volume - np.pi * (radius - wall) ** 2 * (height - 2 * wall)
    assert shell_of_mass(volume, area, shell / volume) == pytest.approx(wall, rel=0.01)


def test_a_lid_closed_over_a_hollow_is_right_as_it_is():
    capped = with_cavity(revolved(can(0.05, 0.14)), revolved(raised(can(0.047, 0.134), 0.003)))
    assert kinds(measure_walls(capped), material="ceramic") == []


def test_open_cups_by_their_material():
    assert kinds(measure_walls(revolved(cup(0.004))), material="ceramic") == []
    thin = measure_walls(revolved(cup(0.0006)))
    assert kinds(thin, material="steel") == []
    (finding,) = wall_findings(thin, material="ceramic")
    assert (finding.kind, finding.certainty, finding.column) == (THIN, LIKELY, "wall_m")
    assert "0.6 mm" in finding.finding
    assert "4 mm is usual" in finding.remedy
    assert kinds(thin, material="ceramic", wall_m=0.003) == []
    assert kinds(measure_walls(revolved(cup(0.0001)))) == [(THIN, POSSIBLE)]


def test_walls_partly_fused_are_brought_to_the_others_thickness():
    outline = [
        (0, 0), (0.04, 0), (0.04, 0.03), (0.04, 0.09), (0.036, 0.09), (0.036, 0.032), (0.0399, 0.03),
        (0.0399, 0.004), (0, 0.004),
    ]  # fmt: skip
    (finding,) = wall_findings(measure_walls(revolved(outline)), material="ceramic")
    assert finding.kind == THIN
    assert "is the median of this scan" in finding.remedy


def test_a_cup_filled_from_below_is_found_by_its_mass():
    measures = measure_walls(revolved(cup(0.002, base=0.045)))
    (finding,) = wall_findings(measures, **STEEL, mass_kg=0.2)
    assert (finding.kind, finding.certainty, finding.column) == (HEAVIER, CERTAIN, "shell_m")
    assert "the median of its walls is 2 mm" in finding.remedy


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


def test_an_open_box_of_any_size_is_doubted_and_its_wall_answers():
    measures = measure_walls(open_box(0.02, None))
    assert measures.opening_share == pytest.approx(0.2)
    (finding,) = wall_findings(measures, material="ceramic")
    assert (finding.kind, finding.certainty, finding.column) == (ONE_LAYER, LIKELY, "wall_m")
    assert "openings make 20% of its area" in finding.finding
    assert wall_findings(measures, material="ceramic", wall_m=0.002) == ()
    assert measure_walls(open_box(0.02, 0.002)).opening_share == 0


def test_a_box_of_one_layer_is_told_from_one_of_boards():
    (finding,) = wall_findings(measure_walls(open_box(0.4, None)), material="plastic")
    assert (finding.kind, finding.certainty, finding.column) == (ONE_LAYER, LIKELY, "shell_m")
    # A shell that the solver's mesh may not hold is said to be so.
    assert "1/200 of its length" in finding.remedy
    assert kinds(measure_walls(open_box(0.4, None))) == [(ONE_LAYER, LIKELY)]
    assert kinds(measure_walls(open_box(0.4, 0.01)), material="plastic") == []
    assert kinds(measure_walls(open_box(0.4, None)), material="plastic", shell_m=0.003) == []


@pytest.mark.parametrize(("mass", "kind", "column"), [(0.02, HEAVIER, "shell_m"), (0.2, LIGHTER, "wall_m")])
def test_a_mass_alone_contradicts_a_scan(mass, kind, column):
    bar = Surface(cube(1.0).vertices * [0.2, 0.01, 0.005], cube(1.0).faces)
    (finding,) = wall_findings(measure_walls(bar), **STEEL, mass_kg=mass)
    assert (finding.kind, finding.certainty, finding.column) == (kind, CERTAIN, column)
    assert f"as scanned it has 0.0785 kg, published are {mass} kg ({mass / 1e-5:.0f} kg/m3)" in str(finding)
    assert kinds(measure_walls(bar), **STEEL, mass_kg=0.0785) == []


def test_measures_survive_json():
    for surface in (revolved(cup(0.003)), open_box(0.3, None)):
        measures = measure_walls(surface)
        assert WallMeasures(**json.loads(json.dumps(measures.to_dict()))) == measures
    assert measures.thickness()["effective_m"] is None


def test_flat_and_single_faces_are_measured_without_failing():
    flat = Surface(np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]), np.array([[0, 1, 2]]))
    measures = measure_walls(flat)
    assert (measures.closed, measures.median_m, measures.wall_median_m, measures.bulk_m) == (
        False,
        None,
        None,
        0,
    )
    assert kinds(measures, material="ceramic") == []
