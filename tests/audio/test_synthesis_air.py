"""Pressure at a listener against spherical waves."""

import numpy as np
import pytest
from scipy.special import spherical_jn, spherical_yn

from objectfolder.audio.synthesis.air import Air, Listener, quadrupole_efficiency
from objectfolder.audio.synthesis.bank import drive, ring
from objectfolder.audio.synthesis.resonators import Resonators
from objectfolder.errors import QueryError

AIR = Air()
RHO, C = AIR.density_kg_m3, AIR.sound_speed_m_s


def hankel(order: int, x: np.ndarray, derivative: bool = False) -> np.ndarray:
    return spherical_jn(order, x, derivative) + 1j * spherical_yn(order, x, derivative)


def click(listener: Listener, impulse: np.ndarray, mass: float, pulse: float | None, rate: float, n: int):
    sound = np.empty((1, n))
    ring(
        Resonators.of(*listener.click_oscillator(rate)),
        impulse[None] @ listener.click_gains(mass),
        sound,
        pulse=pulse,
    )
    return sound[0]


def test_the_efficiency_is_that_of_a_sphere_in_order_2() -> None:
    x = np.array([1e-2, 0.1, 0.5, 1.0, 2.0, 3.3, 10.0, 100.0])
    expected = 1 / (x**2 * np.abs(hankel(2, x, True)) ** 2)
    np.testing.assert_allclose(quadrupole_efficiency(x), expected, rtol=1e-10)
    assert quadrupole_efficiency(0.0) == 0
    assert quadrupole_efficiency(1e3) == pytest.approx(1, rel=1e-5)


def test_the_radiated_power_is_that_of_the_sphere() -> None:
    """p^2 / rho c over the sphere around the listener is rho c S sigma v^2."""
    area, frequency = 0.05, 900.0
    listener = Listener.at([0.0, 0.0, 1.7], [0, 0, 0], area)
    pressure = listener.modal_weights([frequency])[0]
    radius = np.sqrt(area / (4 * np.pi))
    power = pressure**2 / (RHO * C) * 4 * np.pi * 1.7**2
    efficiency = quadrupole_efficiency(2 * np.pi * frequency * radius / C)
    assert power == pytest.approx(RHO * C * area * efficiency)


@pytest.mark.parametrize("distance", [0.03, 1.0])
def test_the_click_is_the_wave_of_an_accelerated_sphere(distance: float) -> None:
    """The half-sine's spectrum times the exact transfer of a transversely moving sphere.

    A sphere of velocity U exp(-i w t) gives p = i rho c U cos(theta) h_1(k r) / h_1'(k a).
    """
    radius, mass, pulse = 0.0111, 0.0041, 1e-4
    impulse = np.array([0.0, 0.01, 0.02])
    position = distance * np.array([1.0, 2.0, 2.0]) / 3
    listener = Listener.at(position, np.zeros(3), 4 * np.pi * radius**2)
    rate, samples = 2_000_000, 1 << 15
    sound = click(listener, impulse, mass, pulse, rate, samples)

    times = np.arange(samples) / rate
    force = np.where(times <= pulse, np.pi / (2 * pulse) * np.sin(np.pi * times / pulse), 0.0)
    omega = 2 * np.pi * np.fft.rfftfreq(samples, 1 / rate)[1:]
    # numpy's transform has exp(-i w t) in the sum, so waves go as exp(+i w t): conjugate the transfer.
    k = omega / C
    along = impulse @ position / distance / mass
    transfer = 1j * RHO * C * hankel(1, k * distance) / hankel(1, k * radius, True) / (-1j * omega)
    transfer *= np.exp(-1j * k * (distance - radius))  # from the first arrival on
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[1:] = np.fft.rfft(force)[1:] * np.conj(transfer) * along
    truth = np.fft.irfft(spectrum, samples)
    truth += sound.mean() - truth.mean()
    # Where the slope of the pulse jumps, the sum over frequencies rings by a ten thousandth.
    np.testing.assert_allclose(sound, truth, atol=2e-4 * np.abs(sound).max())


def test_the_click_of_an_impulse_decays_as_koss_and_alfredson_have_it() -> None:
    """Far away: rho a c cos(theta) J / (m r) exp(-c t / a) (cos(c t / a) - sin(c t / a))."""
    radius, mass, r = 0.0111, 0.0041, 50.0
    listener = Listener.at([0, 0, r], np.zeros(3), 4 * np.pi * radius**2)
    sound = click(listener, np.array([0.3, 0.0, 0.02]), mass, None, 1e6, 400)
    x = C * np.arange(400) / 1e6 / radius
    expected = RHO * radius * C * 0.02 / (mass * r) * np.exp(-x) * (np.cos(x) - np.sin(x))
    np.testing.assert_allclose(sound, expected, atol=1e-3 * expected[0])


def test_the_click_falls_with_distance_follows_the_side_and_is_linear() -> None:
    impulse = np.array([0.0, 0.0, 0.01])

    def peak(position: list[float], push: np.ndarray = impulse) -> float:
        heard = click(Listener.at(position, np.zeros(3), 1.5e-3), push, 0.004, 1e-4, 44100, 200)
        return float(heard[np.abs(heard).argmax()])

    assert peak([0, 0, 2.0]) == pytest.approx(peak([0, 0, 1.0]) / 2, rel=0.02)
    assert peak([0, 0, -1.0]) == pytest.approx(-peak([0, 0, 1.0]))
    assert peak([1.0, 0, 0]) == 0
    assert peak([0, 0, 1.0], 3 * impulse) == pytest.approx(3 * peak([0, 0, 1.0]))
    assert peak([0, 0, 1.0]) > 0


def test_a_sampled_force_clicks_like_the_pulse_it_samples() -> None:
    listener = Listener.at([0, 0.2, 1.0], np.zeros(3), 1.5e-3)
    pulse, rate, impulse = 1e-3, 192000, np.array([0.0, 0.002, 0.01])
    times = np.arange(round(pulse * rate) + 1) / rate
    force = np.pi / (2 * pulse) * np.sin(np.pi * times / pulse)[:, None] * impulse
    sound = np.empty((1, 1000))
    drive(
        Resonators.of(*listener.click_oscillator(rate)), listener.click_gains(0.004)[None], force[None], sound
    )
    expected = click(listener, impulse, 0.004, pulse, rate, 1000)
    np.testing.assert_allclose(sound[0], expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("position", [[0, 0, 0.01], [np.nan, 0, 1], [1.0, 2.0]])
def test_impossible_listeners_are_refused(position: list) -> None:
    with pytest.raises(QueryError, match="listener"):
        Listener.at(position, np.zeros(3), 0.01)
