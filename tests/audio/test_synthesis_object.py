"""Contacts on an Object File: pulses, listeners, streams, and what has no audible mode."""

import copy
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rounding import assert_equal_but_for_rounding

import objectfolder
from objectfolder.audio.synthesis import ContactBody
from objectfolder.audio.synthesis.sound_queries import SoundQueries
from objectfolder.audio.synthesis.struck_body import RigidBody, StruckBody
from objectfolder.errors import QueryError
from objectfolder.object_file import ObjectFile

RATE = 44100
SAMPLED = {"impulses_n_s": None, "forces_n": np.zeros((2, 5, 3))}
BODY = {
    "mass_kg": 0.0749,
    "filled_mass_kg": 0.0749,
    "centre_of_mass_m": [0.0, 0.0, 0.0],
    "inertia_kg_m2": [[6.0e-6, 0, 0], [0, 9.0e-5, 0], [0, 0, 9.5e-5]],
}
EARS = np.array([[0.6, -0.04, 0.8], [0.6, 0.14, 0.8]])
STRIKER = ContactBody(2.0e11, 0.29, 0.004, 0.002)


@pytest.fixture(scope="module")
def bar(small_file: Path) -> ObjectFile:
    return objectfolder.load(small_file).with_description(body=BODY)


def die() -> StruckBody:
    """A 16 mm die of plastic: 4.4 g, its first mode far above 20 kHz."""
    side = 0.016
    mass = 1070 * side**3
    rigid = RigidBody(mass, np.zeros(3), mass * side**2 / 6 * np.eye(3), 6 * side**2)
    none = np.zeros(0)

    def nothing(points: np.ndarray) -> np.ndarray:
        return np.zeros((len(points), 3, 0))

    return StruckBody(none, none, none, nothing, np.zeros_like, rigid, (1.4e9, 0.35))


def test_a_16_mm_die_has_no_audible_mode_and_clicks() -> None:
    points, impulses = np.array([[0.0, 0.0, 0.008]]), np.array([[0.0, 0.0, -0.004]])
    (_, silent, _) = next(die().sounds(points, impulses, 0.05, RATE))
    assert not silent.any()
    listeners = np.array([[0.0, 0.0, 0.5]])
    (_, heard, _) = next(die().sounds(points, impulses, 0.05, RATE, pulse=STRIKER, listeners=listeners))
    sound = heard[0, 0]
    peak = np.abs(sound).max()
    # A light knock at half a metre: between 60 and 110 dB re 20 uPa at its peak.
    assert 0.02 < peak < 6
    arrival = (0.5 - 0.016 * np.sqrt(6 / (4 * np.pi))) / 343.2 * RATE
    assert np.flatnonzero(sound)[0] == np.ceil(arrival)
    # A click: over within two milliseconds of its arrival, and it starts with suction, for the die recoils.
    assert np.abs(sound[int(arrival) + 90 :]).max() < 1e-6 * peak
    assert sound[int(arrival) + 3] < 0


def test_the_click_alone_is_what_no_mode_leaves(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(2, seed=1, reachable=False)
    ask = {"duration_s": 0.05, "pulse": 2e-4, "listener": EARS[0]}
    whole = bar.strike(points, -0.01 * normals, **ask)
    click = bar.strike(points, -0.01 * normals, modes=0, **ask)
    assert np.abs(click).max() > 0
    late = round(0.02 * RATE)
    assert not click[:, late:].any() or np.abs(click[:, late:]).max() < 1e-9
    assert np.abs(whole[:, late:]).max() > 100 * np.abs(click[:, late:]).max()


def test_two_ears_hear_what_each_hears_alone(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(3, seed=2, reachable=False)
    both = bar.strike(points, -normals, 0.05, pulse=STRIKER, listener=EARS)
    assert both.shape == (3, 2, 2205)
    for ear in range(2):
        alone = bar.strike(points, -normals, 0.05, pulse=STRIKER, listener=EARS[ear])
        assert alone.shape == (3, 2205)
        assert_equal_but_for_rounding(alone, both[:, ear])
    assert not np.array_equal(both[:, 0], both[:, 1])


def test_twice_as_far_is_half_as_loud_and_later(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(1, seed=3, reachable=False)
    near, far = (
        bar.strike(points, -normals, 0.2, pulse=5e-4, listener=np.array([0.0, 0.0, r]))[0] for r in (4.0, 8.0)
    )
    delay = np.flatnonzero(far)[0] - np.flatnonzero(near)[0]
    assert delay == pytest.approx(4.0 / 343.2 * RATE, abs=1)
    ratio = np.sqrt(np.mean(far[delay + 1000 :] ** 2) / np.mean(near[1000:-delay] ** 2))
    assert ratio == pytest.approx(0.5, rel=0.01)


def test_a_contact_on_a_vertex_or_an_edge_sounds_as_one_beside_it(bar: ObjectFile) -> None:
    corners = bar.surface.vertices[bar.surface.faces[::40]]
    force = np.array([0.3, 0.2, 1.0])
    for on in (corners[:, 0], (corners[:, 0] + corners[:, 1]) / 2):
        beside = on + 1e-6 * (corners.mean(axis=1) - on)
        # The normal of an edge is that of one of its faces: observed all over the surface.
        sound, near = (bar.strike(points, force, 0.02, pulse=2e-4, observed="rms") for points in (on, beside))
        assert np.isfinite(sound).all()
        size = np.abs(sound).max(axis=1)
        assert (size > 0).all()
        # AudioNet's normals jump across a sharp edge, and its gains by some per cent with them.
        assert (np.abs(sound - near).max(axis=1) < 0.1 * size).all()
        assert np.median(np.abs(sound - near).max(axis=1) / size) < 1e-3


def test_each_contact_may_have_its_own_pulse(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(3, seed=10, reachable=False)
    pulses = np.array([1e-4, 2e-3, 1e-4])
    together = bar.strike(points, -normals, 0.02, pulse=pulses)
    for index, pulse in enumerate(pulses):
        alone = bar.strike(points[index], -normals[index], 0.02, pulse=pulse)
        assert_equal_but_for_rounding(alone[0], together[index])


def test_a_harder_blow_of_a_striker_is_shorter(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(1, seed=4, reachable=False)
    soft, hard = (
        bar.strike(points, -impulse * normals, 0.1, pulse=STRIKER)[0] / impulse for impulse in (1e-4, 1e-1)
    )
    assert np.abs(np.diff(hard)).max() > np.abs(np.diff(soft)).max()


def test_a_striker_shares_its_energy_out(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(4, seed=4, reachable=False)
    lossy = replace(STRIKER, restitution=0.6)
    sound = bar.strike(points, velocities_m_s=-0.5 * normals, duration_s=0.05, pulse=lossy)
    went = sound.energy_j
    np.testing.assert_allclose(went.striker, 0.002 * 0.5**2 / 2)
    np.testing.assert_allclose(sum(went[1:]), went.striker)
    assert (np.array(went) > 0).all()
    assert sound[:2].energy_j is None
    # At the speed at which rigid bodies would pass this impulse on.
    impulses = bar.sound._struck_body(None).passed_on(points, -0.5 * normals, lossy)
    np.testing.assert_array_equal(bar.strike(points, impulses, 0.05, pulse=lossy), sound)
    assert not bar.strike(points, 0 * impulses, 0.05, pulse=lossy).any()
    silent = bar.strike(points, velocities_m_s=0 * normals, duration_s=0.05, pulse="steel")
    assert not silent.any()


def test_a_collision_does_not_depend_on_the_rate(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(1, seed=4, reachable=False)
    once, twice = (
        bar.strike(
            points, velocities_m_s=-normals, duration_s=0.05, sample_rate_hz=rate, modes=8, pulse="wood"
        )
        for rate in (RATE, 2 * RATE)
    )
    np.testing.assert_allclose(twice[:, ::2], once, atol=1e-6 * np.abs(once).max())


def test_sampled_forces_of_a_half_sine_sound_as_the_pulse(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(2, seed=5, reachable=False)
    pulse, rate = 2e-3, 192000
    times = np.arange(round(pulse * rate) + 1) / rate
    shape = np.pi / (2 * pulse) * np.sin(np.pi * times / pulse)
    for listener in (None, np.array([0.0, 0.0, 0.004 + 343.2 / rate * 300])):
        forces = -normals[:, None, :] * shape[None, :, None]
        sampled = bar.strike(points, None, 0.03, rate, forces_n=forces, listener=listener)
        closed = bar.strike(points, -normals, 0.03, rate, pulse=pulse, listener=listener)
        # A delay of whole samples against one to the bit: half a sample at most of the highest mode excited.
        assert np.abs(sampled - closed).max() < (2e-3 if listener is None else 0.05) * np.abs(closed).max()


def test_a_stream_is_the_offline_sound_whatever_its_blocks(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(3, seed=6, reachable=False)
    starts, pulses = (0, 300, 1111), (None, 3e-4, STRIKER)
    for listener, channels in ((None, 1), (EARS, 2)):
        stream = bar.stream(RATE, listener=listener)
        pieces = []
        while stream.now < 6000:
            for point, normal, start, pulse in zip(points, normals, starts, pulses, strict=True):
                if stream.now <= start < stream.now + 96:
                    stream.strike(point, -normal, at=start, pulse=pulse)
            pieces.append(stream.block(96))
        streamed = np.concatenate(pieces, axis=1)
        assert streamed.shape[0] == channels
        offline = np.zeros_like(streamed)
        for point, normal, start, pulse in zip(points, normals, starts, pulses, strict=True):
            sound = bar.strike(point, -normal, 1.0, pulse=pulse, listener=listener)
            offline[:, start:] += np.atleast_2d(sound[0])[:, : streamed.shape[1] - start]
        # The offline answer is rounded to float32.
        np.testing.assert_allclose(streamed, offline, atol=1e-6 * np.abs(offline).max())


def test_a_stream_takes_sampled_forces_and_refuses_what_is_off(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(1, seed=7, reachable=False)
    force = -normals[0] * np.hanning(80)[:, None]
    stream = bar.stream(RATE)
    assert stream.silent
    stream.strike(points[0], force_n=force, at=10)
    sound = stream.block(1000)[0]
    offline = bar.strike(points, None, 990 / RATE, forces_n=force)[0]
    np.testing.assert_allclose(sound[10:], offline, atol=1e-6 * np.abs(offline).max())
    assert not sound[:10].any()
    with pytest.raises(QueryError, match="off the surface"):
        stream.strike(points[0] + 0.01 * normals[0], normals[0])
    with pytest.raises(QueryError, match="pulse"):
        stream.strike(points[0], force_n=force, pulse=1e-3)


def test_many_contacts_take_bounded_memory() -> None:
    """Hundreds of thousands of contacts are asked and taken a part at a time."""
    modes, contacts = 16, 200_000
    random = np.random.default_rng(0)
    eigenvalues = (2 * np.pi * np.sort(random.uniform(300, 18000, modes))) ** 2
    fields = random.normal(size=(3, modes))
    rigid = RigidBody(0.1, np.zeros(3), None, 0.02)
    body = StruckBody(
        eigenvalues,
        np.full(modes, 9.0),
        np.ones(modes),
        lambda p: p[:, :1, None] * fields,
        np.ones_like,
        rigid,
        None,
    )
    points, forces = random.normal(size=(contacts, 3)), random.normal(size=(contacts, 3))
    count, first_sounds = 0, {}
    tracemalloc.start()
    try:
        for rows, sounds, _ in body.sounds(points, forces, 40 / RATE, RATE):
            count += len(sounds)
            if rows.start == 0:
                first_sounds[0] = sounds[0].copy()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert count == contacts
    assert peak < 150e6
    (_, alone, _) = next(body.sounds(points[:1], forces[:1], 40 / RATE, RATE))
    assert_equal_but_for_rounding(alone[0], first_sounds[0])


def test_parts_are_the_whole(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(7, seed=8, reachable=False)
    whole = bar.strike(points, -normals, 0.02, pulse=3e-4, listener=EARS)
    parts = np.concatenate(
        [part for _, part in bar.strikes(points, -normals, 0.02, pulse=3e-4, listener=EARS)]
    )
    assert_equal_but_for_rounding(parts, whole)


def test_what_is_impossible_is_refused_by_name(subtests: pytest.Subtests, bar: ObjectFile) -> None:
    for change, where in [
        ({"impulses_n_s": np.full((2, 3), np.nan)}, "impulses_n_s"),
        (SAMPLED | {"forces_n": np.full((2, 5, 3), np.nan)}, "forces_n"),
        (SAMPLED | {"forces_n": np.zeros((2, 5, 2))}, "forces_n"),
        ({"impulses_n_s": np.zeros((3, 3))}, "impulses_n_s"),
        (SAMPLED | {"pulse": 1e-3}, "pulse"),
        ({"pulse": -1.0}, "pulse"),
        ({"pulse": np.full(3, 1e-3)}, "pulse"),
        ({"pulse": np.full(1, 1e-3)}, "pulse"),
        ({"pulse": np.array([1e-3, np.nan])}, "pulse"),
        ({"listener": np.zeros(3)}, "listener"),
        ({"listener": np.full(3, np.nan)}, "listener"),
        ({"observed": "ear"}, "observed"),
        ({"observed": np.full(3, 9.0)}, "observed"),
        ({"duration_s": np.nan}, "duration_s"),
        ({"duration_s": 0.0}, "duration_s"),
        ({"sample_rate_hz": -8000}, "sample_rate_hz"),
    ]:
        with subtests.test(change=change):
            points, normals = bar.sample_contacts(2, seed=9, reachable=False)
            with pytest.raises(QueryError, match=where):
                bar.strike(**({"points": points, "impulses_n_s": -normals, "duration_s": 0.01} | change))


def test_without_a_mass_there_is_no_pressure(small_file: Path) -> None:
    unknown = objectfolder.load(small_file).with_description(body=None)
    points, normals = unknown.sample_contacts(1, seed=9, reachable=False)
    with pytest.raises(QueryError, match="listener"):
        unknown.strike(points, normals, 0.01, listener=EARS)
    with pytest.raises(QueryError, match="pulse"):
        unknown.strike(points, normals, 0.01, pulse=STRIKER)


def flipped(file: ObjectFile) -> ObjectFile:
    """Return the file with every second mode shape of the other sign, as a solver may give them."""
    variant = copy.copy(file)
    gains_at = file.modes.gains_at
    signs = (-1.0) ** np.arange(len(file.modes.eigenvalues))
    modes = copy.copy(file.modes)
    # Of this copy alone; `gains` asks it.
    vars(modes)["gains_at"] = lambda places: gains_at(places) * signs
    variant.sound = SoundQueries(modes, file.sound.contacts, file.description)
    return variant


def test_no_velocity_of_the_surface_depends_on_the_signs_of_mode_shapes(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(3, seed=11, reachable=False)
    elsewhere = bar.sample_contacts(2, seed=12, reachable=False)[0]
    for observed in ("contact", elsewhere):
        sound = bar.strike(points, -normals, 0.02, observed=observed)
        assert_equal_but_for_rounding(flipped(bar).strike(points, -normals, 0.02, observed=observed), sound)
    named = bar.strike(points, -normals, 0.02, observed="rms")
    assert (
        np.abs(flipped(bar).strike(points, -normals, 0.02, observed="rms") - named).max() > 0.1 * named.max()
    )
    times = np.linspace(0, 0.1, 5)
    level = bar.rms_velocity(points, -normals, times)
    np.testing.assert_allclose(flipped(bar).rms_velocity(points, -normals, times), level, rtol=1e-12)


def test_the_contact_starts_with_the_velocity_that_its_modes_have_there(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(4, seed=13, reachable=False)
    shapes = bar.modes.gains(points)
    force = np.array([0.3, -0.2, 0.9])
    expected = (np.einsum("nkm,k->nm", shapes, force) * np.einsum("nkm,nk->nm", shapes, normals)).sum(axis=1)
    np.testing.assert_allclose(bar.strike(points, np.tile(force, (4, 1)), 0.01)[:, 0], expected, rtol=1e-5)


def test_striking_here_and_observing_there_is_reciprocal(bar: ObjectFile) -> None:
    """Maxwell and Betti: a push along the normal at x moves y as the same push at y moves x."""
    (x, y), (up, out) = bar.sample_contacts(2, seed=14, reachable=False)
    sound = bar.strike(x, up, 0.02, observed=y)
    assert_equal_but_for_rounding(bar.strike(y, out, 0.02, observed=x), sound)
    both = bar.strike(x, up, 0.02, observed=np.stack([y, x]))
    assert both.shape == (1, 2, len(sound[0]))
    assert_equal_but_for_rounding(both[:, 0], sound)


def test_the_level_is_the_root_of_the_mean_square_over_surface_and_time(bar: ObjectFile) -> None:
    """Against strikes observed all over the surface: modes are nearly orthogonal there."""
    points, normals = bar.sample_contacts(1, seed=15, reachable=False)
    everywhere = bar.sample_contacts(400, seed=16, reachable=False)[0]
    sound = bar.strike(points, -normals, 0.01, observed=everywhere)[0].astype(np.float64)
    times = np.arange(sound.shape[1]) / RATE
    level = bar.rms_velocity(points, -normals, times)[0]
    assert abs(20 * np.log10(np.sqrt((sound**2).mean()) / np.sqrt((level**2).mean()))) < 1.0


def test_a_stream_is_observed_as_a_strike_is(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(2, seed=17, reachable=False)
    for observed in ("contact", "rms", points[1]):
        stream = bar.stream(RATE, observed=observed)
        stream.strike(points[0], -normals[0])
        np.testing.assert_allclose(
            stream.block(500)[0],
            bar.strike(points[0], -normals[0], 500 / RATE, observed=observed)[0],
            atol=1e-5,
        )
