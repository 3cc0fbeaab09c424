"""Bodies of revolution: their surfaces are closed, outward and on the curves, their spectra converged."""

from pathlib import Path

import numpy as np
import pytest

from objectfolder.making.materials import read_materials
from tests.references.axisymmetric import Discretisation
from tests.references.bodies import BODIES
from tests.references.revolution import surface_of_revolution

pytestmark = pytest.mark.release("tests.references")
MATERIALS = read_materials(Path(__file__).parents[2] / "data" / "materials.csv")


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("segments", [None, 36])
def test_surfaces_are_closed_outward_and_tend_to_the_volume(
    name: str, segments: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    meridian = BODIES[name]().meridian
    exact = Discretisation.of(meridian, (8, 6)).volume()
    errors = []
    for edge, turn in ((0.006, 0.5), (0.003, 0.25)):
        monkeypatch.setattr("tests.references.meridian.TURN", turn)
        surface = surface_of_revolution(meridian, edge, segments and int(segments * 0.006 / edge))
        faces = surface.faces
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        assert len(np.unique(edges, axis=0)) == len(edges)
        np.testing.assert_array_equal(np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0))
        used = np.unique(faces)
        assert len(used) == len(surface.vertices)
        assert len(used) - len(edges) // 2 + len(faces) == 2
        assert surface.face_areas.min() > 0
        corner = surface.vertices[faces]
        errors.append(np.linalg.det(corner).sum() / 6 / exact - 1)
    assert abs(errors[0]) < 1.5e-2
    assert abs(errors[1]) < 4e-3


@pytest.mark.parametrize("name", BODIES)
def test_vertices_lie_on_the_outline(name: str) -> None:
    body = BODIES[name]()
    outline = body.meridian.outline(body.edge_m)
    vertices = body.surface().vertices
    r = np.hypot(vertices[:, 0], vertices[:, 1])
    distance = np.hypot(r[:, None] - outline[:, 0], vertices[:, 2][:, None] - outline[:, 1]).min(axis=1)
    assert distance.max() < 1e-12
    assert outline[0, 0] == outline[-1, 0] == 0
    assert (outline[1:-1, 0] > 0).all()


def test_the_bowl_has_its_known_spectrum() -> None:
    """Known to 4e-6 from another axisymmetric code: first 561.57 Hz, 73 modes below 20 kHz, 39 distinct."""
    ceramic = MATERIALS["ceramic"]
    spectrum = BODIES["bowl"]().spectrum(ceramic, 20000.0)
    assert spectrum.convergence < 1e-6
    assert len(spectrum) == 73
    assert len(spectrum.wavenumbers) == 39
    assert spectrum.frequencies_hz(ceramic)[0] == pytest.approx(561.57, abs=0.005)
    assert spectrum.families[0] == "n = 2"


@pytest.mark.parametrize(("name", "count"), [("bell", 29), ("cup", 27), ("glass", 56), ("plate", 82)])
def test_every_spectrum_is_converged(name: str, count: int) -> None:
    body = BODIES[name]()
    spectrum = body.spectrum(MATERIALS[body.material], 20000.0)
    assert spectrum.convergence < 1e-5
    assert len(spectrum) == count
