"""Collisions against an integration of the coupled bodies that shares no line with ours, and their energy."""

import numpy as np
import pytest

from objectfolder.audio.synthesis import HertzContact
from objectfolder.audio.synthesis.collision import Collider, collide
from objectfolder.audio.synthesis.oscillators import Oscillators
from objectfolder.audio.synthesis.pulses import ForceProfile
from objectfolder.audio.synthesis.resonators import Resonators
from objectfolder.errors import QueryError
from tests.references.coupled_contact import coupled_contact

CONTACT = HertzContact(modulus_pa=5e10, radius_m=0.01, mass_kg=0.018)
SPEED_M_S = 1.3


def body(seed: int, modes: int, damping: float) -> Collider:
    random = np.random.default_rng(seed)
    angular = 2 * np.pi * np.sort(random.uniform(1e3, 2e4, modes))
    return Collider(Oscillators(angular**2, damping * angular, 1.0), 2.0 * random.standard_normal(modes))


@pytest.mark.parametrize("restitution", [1.0, 0.6])
@pytest.mark.parametrize("bodies", [1, 2])
def test_energy_of_the_modes_is_that_of_a_fine_integration(bodies: int, restitution: float) -> None:
    colliders = [body(seed, 12, 2e-3) for seed in range(bodies)]
    collision = collide(colliders, CONTACT, SPEED_M_S, restitution)
    end_s = collision.profile.duration_s
    impulse, energies = coupled_contact(colliders, CONTACT, SPEED_M_S, restitution, end_s)
    assert collision.impulse_n_s == pytest.approx(impulse, rel=1e-3)
    np.testing.assert_allclose(collision.vibration_j, energies, rtol=5e-3)
    assert (collision.vibration_j > 0.05 * CONTACT.mass_kg * SPEED_M_S**2 / 2).all()


def test_no_energy_comes_or_goes_without_damping() -> None:
    collision = collide([body(3, 40, 0.0)], CONTACT, SPEED_M_S)
    before = CONTACT.mass_kg * SPEED_M_S**2 / 2
    parting_m_s = SPEED_M_S - collision.impulse_n_s / CONTACT.mass_kg
    after = CONTACT.mass_kg * parting_m_s**2 / 2 + collision.vibration_j.sum()
    assert after == pytest.approx(before, rel=1e-12)


def test_rigid_bodies_part_as_the_restitution_says() -> None:
    for restitution in (1.0, 0.9, 0.5, 0.1, 0.01):
        collision = collide([], CONTACT, SPEED_M_S, restitution)
        impulse = (1 + restitution) * CONTACT.mass_kg * SPEED_M_S
        assert collision.impulse_n_s == pytest.approx(impulse, rel=1e-4)
    with pytest.raises(QueryError, match="restitution"):
        collide([], CONTACT, SPEED_M_S, 0.0)


def test_a_held_force_sounds_in_closed_form_between_its_steps() -> None:
    """An undamped mode under 1 N moves about 1 / w^2; samples begin .3 of one after the force."""
    angular, rate, step_s, ahead = 2 * np.pi * 3000.0, 44100.0, 3e-5, 0.3
    modes = Oscillators(np.array([angular**2]), np.zeros(1), rate)
    bank = Resonators.of(modes, modes.response_weights("displacement"))
    onset, states = bank.onset(np.ones((1, 1)), ForceProfile(step_s, np.ones(7)), ahead, 100)
    sound = np.zeros((1, 30))
    sound[:, : onset.shape[1]] = onset
    bank.ring(states, sound, onset.shape[1])
    times = (np.arange(30) + ahead) / rate
    since = np.maximum(times - 7 * step_s, 0.0)
    expected = (np.cos(angular * since) - np.cos(angular * times)) / angular**2
    np.testing.assert_allclose(sound[0], expected, atol=1e-12 / angular**2)
