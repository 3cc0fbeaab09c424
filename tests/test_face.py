"""What a user meets first: the namespace, an object's own words, and calls without arguments."""

import inspect
import warnings
from collections.abc import Callable
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.io import wavfile

import objectfolder
from objectfolder import Environment, Lamps, ObjectFile, Press, QueryError, Sound, Touches
from pipeline.run.single_build import Building, Built
from tests.conftest import REPOSITORY
from tests.test_imports import loaded_by

TOP, LAMP = [0.0, 0.0, 0.004], [0.1, 0.1, 0.3]
POSE = np.eye(4) + np.eye(4, k=1) * [[0.0], [0.0], [0.3], [0.0]]  # above, looking down


@pytest.fixture
def bar(small_file: Path) -> ObjectFile:
    return objectfolder.load(small_file)


def test_the_namespace_has_every_public_name_and_imports_them_late() -> None:
    assert dir(objectfolder) == sorted(objectfolder.__all__)
    assert all(getattr(objectfolder, name).__name__ == name for name in objectfolder.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'ObjectFolder'"):
        objectfolder.ObjectFolder  # noqa: B018
    assert "numpy" not in loaded_by("import objectfolder")


def test_an_object_says_what_it_is(bar: ObjectFile) -> None:
    assert repr(bar) == "ObjectFile('Glass bar', glass, unknown mass, 12.0 x 3.0 x 0.8 cm, 8 modes)"
    assert (bar.name, bar.material, bar.mass_kg) == ("Glass bar", "glass", None)
    assert bar.length_m == pytest.approx(0.12, abs=1e-5)
    np.testing.assert_array_equal(bar.bounds_m, bar.surface.bounds)
    assert bar.fidelity == bar.description["fidelity"]
    nameless = bar.with_description(object={"id": "b"}, material=None, fidelity=None)
    assert (nameless.name, nameless.material, nameless.fidelity) == ("b", None, None)
    assert objectfolder.example("mug").mass_kg == pytest.approx(0.2858, abs=1e-4)


def test_objects_of_equal_content_are_equal(bar: ObjectFile, small_file: Path) -> None:
    same = objectfolder.load(small_file)
    assert bar == same
    assert hash(bar) == hash(same)
    assert bar != bar.with_description(fidelity=None)
    content = bar.content()
    tensors = {name: tensor.copy() for name, tensor in content.tensors.items()}
    tensors["audio.coefficients" if "audio.coefficients" in tensors else max(tensors)].flat[0] += 1
    assert bar != ObjectFile(
        bar.surface, bar.frame, bar.vision, bar.modes, bar.touch.net, bar.description, tensors
    )
    assert bar != "bar"


def test_a_view_without_a_light_has_the_data_sets_lamp_beside_the_camera(bar: ObjectFile) -> None:
    cameras, _ = bar.sample_views(2)
    direction = cameras[:, :3, :3] @ np.array([-1.0, 1.0, 2.0]) / np.sqrt(6)
    lamps = bar.frame.centre + bar.frame.scale * direction
    images = bar.render(cameras, resolution=16)
    np.testing.assert_array_equal(images, bar.render(cameras, lamps, resolution=16))
    assert (images < 255).any()


def test_without_an_impulse_a_strike_is_one_newton_second_inwards(bar: ObjectFile) -> None:
    points, normals = bar.sample_contacts(2, reachable=False)
    np.testing.assert_array_equal(
        bar.strike(points, duration_s=0.01), bar.strike(points, -normals, duration_s=0.01)
    )


def test_touches_are_taken_apart(bar: ObjectFile) -> None:
    touches = bar.press([TOP, [0.03, 0.0, 0.004]], resolution=(20, 10))
    assert repr(touches) == "Touches(2 of 20 x 10 pixels, 2 reachable)"
    assert [len(touch) for touch in touches] == [1, 1]
    last = touches[-1]
    assert isinstance(last, Touches)
    np.testing.assert_array_equal(last.rgb, touches.rgb[1:])
    np.testing.assert_array_equal(touches[touches.points[:, 0] > 0.01].points, last.points)
    with pytest.raises(IndexError):
        touches[2]
    with pytest.warns(DeprecationWarning, match="Touches: the attribute is now `depth_m`"):
        np.testing.assert_array_equal(touches.depth, touches.depth_m)
    assert repr(bar.reach([TOP], rolls=3)) == "Reach(1 points at 3 rolls, 1 reachable)"


def test_a_sound_says_what_it_is_and_writes_itself(bar: ObjectFile, tmp_path: Path) -> None:
    sounds = bar.strike([TOP, TOP], duration_s=0.1, sample_rate_hz=8000)
    assert isinstance(sounds, Sound)
    assert repr(sounds) == f"Sound((2, 800), 0.1 s at 8000 Hz, peak {np.abs(sounds).max():.3g})"
    assert repr(sounds[:, ::2]).startswith("array(")
    assert sounds[0].write(tmp_path / "a.wav", gain=2.0) == 2.0
    rate, samples = wavfile.read(tmp_path / "a.wav")
    assert rate == 8000
    np.testing.assert_array_equal(samples, 2 * sounds[0])
    with pytest.raises(QueryError, match="not one sound"):
        sounds.write(tmp_path / "b.wav")
    with pytest.raises(QueryError, match="sample rate is not known"):
        sounds[0, ::2].write(tmp_path / "b.wav")


def test_build_asks_the_installed_factory(monkeypatch: pytest.MonkeyPatch, small_file: Path) -> None:
    target = "pipeline.run.object_file_builder:build"
    assert f'object_file = "{target}"' in (REPOSITORY / "pyproject.toml").read_text()
    entry = EntryPoint("object_file", target, "objectfolder.builders")
    monkeypatch.setattr("objectfolder.factory.entry_points", lambda **_: EntryPoints([entry]))
    calls = []

    def build_object_file(building: Building, output: Path, confirm: object) -> Built:
        calls.append((building, output))
        return Built({}, "1 plain colour", ("thin walls",))

    monkeypatch.setattr("pipeline.run.object_file_builder.build_object_file", build_object_file)
    with pytest.warns(UserWarning, match="thin walls") as warned:
        built = objectfolder.build(
            "bar.obj", material="glass", length_m=0.12, output=small_file, overwrite=True
        )
    assert warned[0].filename == __file__
    assert calls == [(Building(Path("bar.obj"), material="glass", length_m=0.12), small_file)]
    assert built == objectfolder.load(small_file)


def test_build_refuses_a_doubtful_size_and_a_file_that_is_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    entry = EntryPoint("object_file", "pipeline.run.object_file_builder:build", "objectfolder.builders")
    monkeypatch.setattr("objectfolder.factory.entry_points", lambda **_: EntryPoints([entry]))
    mesh = tmp_path / "box.stl"
    trimesh.creation.box((2.0, 0.1, 0.02)).export(mesh)
    output = tmp_path / "box.safetensors"
    refused = r"2 m long by the file, as if normalised\. State length_m in metres, or give any_size=True\."
    with pytest.raises(objectfolder.InputError, match=refused):
        objectfolder.build(mesh, material="steel", output=output)
    with pytest.raises(objectfolder.InputError, match=r"31400 kg of steel\. Correct length_m or material"):
        objectfolder.build(mesh, material="steel", length_m=20.0, output=output)
    output.touch()
    with pytest.raises(objectfolder.InputError, match=r"is there already.*overwrite=True"):
        objectfolder.build(mesh, material="steel", length_m=0.2, output=output)


def test_build_names_the_extra_where_the_factory_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    for entries, finding in (
        (EntryPoints([]), "the factory: is not installed"),
        (EntryPoints([EntryPoint("object_file", "no_package:build", "g")]), "no_package: is not installed"),
    ):
        monkeypatch.setattr("objectfolder.factory.entry_points", lambda entries=entries, **_: entries)
        with pytest.raises(objectfolder.MissingPackageError, match=finding) as error:
            objectfolder.build("bar.obj", material="glass", output="bar.safetensors")
        assert 'pip install "objectfolder-factory[factory]"' in str(error.value)


def test_queries_of_a_sense_are_at_hand_in_short(bar: ObjectFile) -> None:
    assert bar.render == bar.sight.render
    assert bar.strike == bar.sound.strike
    assert bar.press == bar.touch.press
    assert (bar.sight.net, bar.sound.net) == (bar.vision, bar.modes)
    names = ["points", "impulses_n_s", "duration_s", "sample_rate_hz", "modes"]
    assert list(inspect.signature(bar.strikes).parameters)[:5] == names
    assert "Sound the object under contacts." in str(ObjectFile.strike.__doc__)
    bar.surface_tolerance_m = 0.01
    assert bar.strike([0.0, 0.0, 0.009], duration_s=0.01).any()


EARLIER: dict[str, tuple[Callable[[ObjectFile], Any], Callable[[ObjectFile], Any]]] = {
    "one lamp": (
        lambda bar: bar.render(camera_to_world=POSE, light_position=LAMP, resolution=8, field_of_view=30),
        lambda bar: bar.render(POSE, LAMP, 8, 30),
    ),
    "coloured lamps": (
        lambda bar: bar.render(POSE, LAMP, 8, light_colour=[1, 0, 0]),
        lambda bar: bar.render(POSE, Lamps(LAMP, [1, 0, 0]), 8),
    ),
    "a map": (
        lambda bar: bar.render(POSE, resolution=8, light=np.ones((4, 8, 3))),
        lambda bar: bar.render(POSE, Environment.of(np.ones((4, 8, 3))), 8),
    ),
    "linear by place": (
        lambda bar: bar.render(POSE, LAMP, 8, 30, True, 4),
        lambda bar: bar.render_linear(POSE, LAMP, 8, 30, sub_rays=4),
    ),
    "linear passes": (
        lambda bar: bar.render(POSE, LAMP, 8, linear=True, passes=["image"])["image"],
        lambda bar: bar.render_linear(POSE, LAMP, 8),
    ),
    "rays": (
        lambda bar: bar.radiance([[0, 0, 0.1]], [[0, 0, -1]], LAMP, light_colour=[2, 2, 2]),
        lambda bar: bar.radiance([[0, 0, 0.1]], [[0, 0, -1]], Lamps(LAMP, [2, 2, 2])),
    ),
    "impulses": (
        lambda bar: bar.strike(TOP, forces=[0, 0, -2], duration=0.01, sample_rate=8000),
        lambda bar: bar.strike(TOP, [0, 0, -2], 0.01, 8000),
    ),
    "forces by keyword": (
        lambda bar: bar.strike(TOP, forces=np.ones((1, 4, 3)), duration_s=0.01),
        lambda bar: bar.strike(TOP, forces_n=np.ones((1, 4, 3)), duration_s=0.01),
    ),
    "forces by place": (
        lambda bar: bar.strike(TOP, np.ones((1, 4, 3)), 0.01),
        lambda bar: bar.strike(TOP, None, 0.01, forces_n=np.ones((1, 4, 3))),
    ),
    "contacts in parts": (
        lambda bar: next(bar.strikes(TOP, forces=[0, 0, -2], duration=0.01))[1],
        lambda bar: next(bar.strikes(TOP, [0, 0, -2], 0.01))[1],
    ),
    "modes by place": (
        lambda bar: bar.strike(TOP, [0, 0, -2], 0.01, 44100, 2),
        lambda bar: bar.strike(TOP, [0, 0, -2], 0.01, modes=2),
    ),
    "a depth and angles": (
        lambda bar: bar.press(TOP, depth=0.0005, tilt=5, azimuth=9, roll=3, resolution=(16, 12)).rgb,
        lambda bar: bar.press(TOP, 0.0005, 5, 9, roll_deg=3, resolution=(16, 12)).rgb,
    ),
    "the net of touch": (
        lambda bar: bar.touch.press(np.array([TOP]), Press(depth_m=0.0005)).rgb,
        lambda bar: bar.touch.net.press(np.array([TOP]), Press(depth_m=0.0005)).rgb,
    ),
    "a part of that net": (lambda bar: bar.touch.samples, lambda bar: bar.touch.net.samples),
    "how many": (lambda bar: bar.sample_views(count=2)[0], lambda bar: bar.sample_views(2)[0]),
}


@pytest.mark.parametrize(("before", "now"), EARLIER.values(), ids=EARLIER.keys())
def test_earlier_calls_answer_the_same_and_warn_the_caller(
    bar: ObjectFile, before: Callable[[ObjectFile], Any], now: Callable[[ObjectFile], Any]
) -> None:
    with pytest.warns(DeprecationWarning, match="goes with") as warned:
        answer = before(bar)
    callers = {(warning.filename, warning.lineno) for warning in warned}
    assert callers == {(__file__, before.__code__.co_firstlineno)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(answer, now(bar))


def test_lamps_and_light_from_all_round_exclude_each_other(bar: ObjectFile) -> None:
    with (
        pytest.warns(DeprecationWarning, match="goes with"),
        pytest.raises(QueryError, match="lamps beside light"),
    ):
        bar.render(POSE, LAMP, 8, light="sky")
    with pytest.raises(QueryError, match="both given"):
        bar.strike(TOP, [0, 0, -1], forces_n=np.ones((1, 4, 3)))
    with pytest.raises(AttributeError, match="no attribute 'flavour'"):
        bar.touch.flavour  # type: ignore[attr-defined]  # noqa: B018
