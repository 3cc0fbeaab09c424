"""What modes lose to the air, against closed forms of a sphere and of a thin disc."""

import numpy as np
import pytest
import trimesh
from structured_solids import box, moved

from objectfolder.audio.air.multipoles import DENSITY_KG_M3, SOUND_SPEED_M_S, Radiation
from objectfolder.audio.synthesis.air import Air, Listener
from objectfolder.making.air.radiation_loss import dampings_of, radiation_dampings, solved_phases
from objectfolder.making.materials import read_materials
from objectfolder.making.modes.modes import modes_of_solid
from objectfolder.surface.surface import Surface

RADIUS_M = 0.05
IMPEDANCE = DENSITY_KG_M3 * SOUND_SPEED_M_S


def spherical_efficiency(order: int, x: float) -> float:
    """1 / (x |h_n'(x)|)^2 of a sphere that moves in one order."""
    square = {0: x**2 / (1 + x**2), 1: x**4 / (4 + x**4), 2: x**6 / (81 + 9 * x**2 - 2 * x**4 + x**6)}
    return square[order]


def test_a_sphere_loses_what_it_radiates_in_closed_form() -> None:
    ball = trimesh.creation.icosphere(4, RADIUS_M)
    surface = Surface(np.array(ball.vertices), np.array(ball.faces))
    x = np.array([0.5, 0.8, 0.83, 1.1, 2.5, 0.9])
    orders = np.array([2, 0, 1, 2, 1, 0])

    def shapes(face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        outward = surface.points_at(face, barycentric)
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        z = outward[:, 2]
        size = np.stack([np.ones(len(z)), z, 1.5 * z**2 - 0.5])[orders]
        return outward[:, :, None] * size.T[:, None]

    hertz = x * SOUND_SPEED_M_S / (2 * np.pi * RADIUS_M)
    rates = radiation_dampings(surface, shapes, np.append(hertz, 0.0)[:-1])
    mean_square = 1 / (2 * orders + 1)
    true = [
        2 * np.pi * RADIUS_M**2 * IMPEDANCE * mean * spherical_efficiency(order, at)
        for order, at, mean in zip(orders, x, mean_square, strict=True)
    ]
    assert np.abs(10 * np.log10(rates / true)).max() < 0.3


def test_the_two_sides_of_a_thin_disc_cancel() -> None:
    """A disc that swings broadside moves air of 8/3 rho a^3 and is a dipole (Lamb, Hydrodynamics, 102)."""
    disc = trimesh.creation.cylinder(RADIUS_M, 0.02 * RADIUS_M, sections=48).subdivide().subdivide()
    surface = Surface(np.array(disc.vertices), np.array(disc.faces))
    x = 0.15

    def swinging(face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        return np.broadcast_to(np.array([0.0, 0.0, 1.0])[:, None], (len(face), 3, 1))

    k = x / RADIUS_M
    rate = radiation_dampings(surface, swinging, np.array([k * SOUND_SPEED_M_S / (2 * np.pi)]))[0]
    force = 8 / 3 * DENSITY_KG_M3 * RADIUS_M**3 * k * SOUND_SPEED_M_S
    true = k**2 * force**2 / (24 * np.pi * IMPEDANCE)
    assert abs(10 * np.log10(rate / true)) < 0.5
    closed = 2 * np.pi * RADIUS_M**2 * IMPEDANCE * spherical_efficiency(0, x)
    assert rate < closed / 50


def test_a_mode_that_does_not_ring_radiates_nothing() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    surface = Surface(np.array(box.vertices), np.array(box.faces))
    assert radiation_dampings(surface, lambda *place: np.zeros((1, 3, 2)), np.zeros(2)).tolist() == [0, 0]


def test_phases_are_solved_close_enough_and_only_where_modes_are() -> None:
    phases = np.array([1.0, 1.01, 1.2, 1.5, 20.0, 3.0, 3.0, 3.1])
    nodes = solved_phases(phases)
    assert np.all(np.diff(nodes) > 0)
    for phase in phases:
        below, above = nodes[nodes <= phase].max(), nodes[nodes >= phase].min()
        assert above - below <= max(0.3, 0.12 * below) + 1e-9
    assert len(nodes) == 6


def test_a_listener_hears_all_that_is_lost() -> None:
    """Intensity over a sphere is twice the rate times the energy of a mode."""
    listener = Listener.at([0.7, 0.0, 0.0], [0.0, 0.0, 0.0], 0.01, Air())
    pressure = listener.radiated_weights(np.array([3.0]))[0]
    power = 4 * np.pi * 0.7**2 * pressure**2 / 2 / IMPEDANCE
    assert power == pytest.approx(2 * 3.0 * 0.5)


def test_multipoles_lose_as_much() -> None:
    k = 20.0
    monopole = Radiation(np.zeros(3), 0.1, np.array([k, 0.0]), np.array([[2j], [0.0]]), np.zeros(2))
    # p = c h_0 Y_00 = c exp(ikr) / (i k r sqrt(4 pi))
    power = 4 * np.pi * (2 / (k * np.sqrt(4 * np.pi))) ** 2 / (2 * IMPEDANCE)
    np.testing.assert_allclose(dampings_of(monopole), [power, 0.0])


def test_decays_have_what_the_air_takes_unless_told_otherwise(glass_bar) -> None:
    glass = read_materials("data/materials.csv")["glass"]
    solid = moved(box((6, 2, 1), (0.12, 0.03, 0.008)), (-0.06, -0.015, -0.004))
    options = {"max_frequency_hz": 5000.0, "training_points": 20, "held_out_points": 5, "seed": 0}
    options |= {"accuracy_cents": 50.0, "highest_order": 3}
    modes = modes_of_solid(glass_bar.surface, solid, glass, **options)
    still = modes_of_solid(glass_bar.surface, solid, glass, radiation="sphere", **options)
    rates = modes["radiation_dampings_per_s"]
    assert (rates > 0).all()
    np.testing.assert_allclose(modes["dampings_per_s"], still["dampings_per_s"] + rates)
    assert "radiation_dampings_per_s" not in still.arrays
    with pytest.raises(ValueError, match="radiation 'none'"):
        modes_of_solid(glass_bar.surface, solid, glass, radiation="none", **options)
