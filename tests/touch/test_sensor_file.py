import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from objectfolder.errors import FormatError, InputError
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.marker_grid import MarkerGrid
from objectfolder.touch.sensor.sensor import Sensor, stored_sensor
from objectfolder.touch.sensor.sensor_file import FOLDER, make_table, read_sensor, sensor_names, write_sensor

DIGIT = (FOLDER / "digit-tacto.yaml").read_text(encoding="utf-8")
GELSIGHT = (FOLDER / "gelsight.yaml").read_text(encoding="utf-8")


def test_tactos_digit_is_what_a_sensor_is_by_default() -> None:
    assert read_sensor("digit-tacto") == Sensor()


@pytest.mark.parametrize("name", sensor_names())
def test_a_sensor_of_the_package_survives_the_object_file(name: str) -> None:
    sensor = read_sensor(name)
    again = Sensor.from_dict(sensor.to_dict())
    assert again == sensor
    assert hash(again) == hash(sensor)
    assert np.array_equal(no_contact_image(again), no_contact_image(sensor))


def test_the_packages_table_is_what_its_illumination_gives() -> None:
    table = read_sensor("gelsight").photometric_table
    assert table is not None
    # Libraries add in different orders on different processors: half precision may round to either side.
    np.testing.assert_allclose(
        make_table("gelsight").coefficients.astype(np.float64),
        table.coefficients.astype(np.float64),
        rtol=2**-10,
        atol=1e-7,
    )


def test_a_user_adds_a_sensor_by_a_path(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(DIGIT.replace("sigma_grey_levels: 7.0", "sigma_grey_levels: 3"))
    assert read_sensor(tmp_path / "mine.yaml").noise_sigma_grey_levels == 3
    assert read_sensor("mine.yaml", tmp_path).noise_sigma_grey_levels == 3


def test_a_sensor_without_a_table_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="DIGIT: has no photometric table"):
        write_sensor(tmp_path / "mine.yaml", Sensor(), "")
    assert not list(tmp_path.iterdir())


def test_a_user_puts_a_calibrated_table_in_place(tmp_path: Path) -> None:
    # A membrane of one colour whatever its slope, of which the right half is brighter.
    coefficients = np.zeros((3, 2, 3, 6))
    coefficients[..., 0], coefficients[..., 1] = 0.5, 0.25
    np.save(tmp_path / "gelsight.npy", coefficients)
    (tmp_path / "mine.yaml").write_text(GELSIGHT)
    image = no_contact_image(read_sensor(tmp_path / "mine.yaml")).astype(float) / 255
    # The camera sees 20.29 of the gel's 25.25 mm.
    assert image[120, 0] == pytest.approx(0.5 - 0.25 * 20.29 / 25.25, abs=0.004)
    assert image[120, -1] == pytest.approx(0.5 + 0.25 * 20.29 / 25.25, abs=0.004)


def test_a_file_in_the_old_spelling_is_read_and_names_the_new_keys(tmp_path) -> None:
    old = DIGIT.replace("colour:", "color:")
    assert old.count("color:") == 4
    (tmp_path / "mine.yaml").write_text(old)
    with pytest.warns(FutureWarning, match="mine.yaml: the key .* is now") as caught:
        assert read_sensor(tmp_path / "mine.yaml") == read_sensor("digit-tacto")
    said = [str(warning.message) for warning in caught]
    assert sum("`color` is now `colour`" in message for message in said) == 3
    assert sum("`base_color` is now `base_colour`" in message for message in said) == 1


def test_a_sensor_answers_to_the_old_spelling_and_is_stored_by_it() -> None:
    with pytest.warns(DeprecationWarning, match="Sensor: `base_color` is now `base_colour`"):
        sensor = Sensor(base_color=0.4)  # type: ignore[call-arg]
    with pytest.warns(DeprecationWarning, match="the attribute is now `base_colour`"):
        assert sensor.base_color == 0.4
    assert sensor.to_dict()["base_color"] == 0.4
    assert Sensor.from_dict(sensor.to_dict()) == sensor


def test_a_mistake_is_named_with_its_file_and_field(subtests: pytest.Subtests, tmp_path) -> None:
    for right, wrong, message in [
        ("width_m: 0.020", "widht_m: 0.020", "unknown key gel.widht_m. Did you mean gel.width_m?"),
        ("width_m: 0.020 #", "#", "no key gel.width_m"),
        ("width_m: 0.020", "width_m: 1e-3", r"gel.width_m is '1e-3'. It must be a finite number (write"),
        ("width_m: 0.020", "width_m: .nan", "gel.width_m is nan"),
        ("image_width: 120", "image_width: 120.5", "camera.image_width is 120.5"),
        ("image_width: 120", "image_width: true", "camera.image_width is True"),
        ("apex_m: [0.022, 0.0, 0.015]", "apex_m: [0.022, 0.0]", "gel.apex_m is [0.022, 0.0]. It must be a"),
        ("name: DIGIT", "name: 5", "name is 5. It must be a text"),
        ("base_colour: 0.3", "base_hue: 0.3", "unknown key photometry.base_hue"),
        ("colour: [0.0, 0.0,", "hue: [0.0, 0.0,", "unknown key photometry.lights[2].hue"),
        ("model: cook_torrance", "model: phong", "photometry.model is 'phong'. It is cook_torrance or table"),
        ("blur_pixels: 7", "blur_pixels: 6", "background_blur_pixels is 6, not odd"),
        ("poisson_ratio: 0.48", "poisson_ratio: 0.5", "gel_poisson_ratio is 0.5"),
        ("field_of_view_deg: 60.0", "field_of_view_deg: 75.0", "the camera sees past the gel's borders"),
    ]:
        with subtests.test(right=right):
            assert right in DIGIT
            (tmp_path / "mine.yaml").write_text(DIGIT.replace(right, wrong))
            with pytest.raises(InputError) as caught:
                read_sensor(tmp_path / "mine.yaml")
            assert str(caught.value).startswith("mine.yaml: ")
            assert message in str(caught.value)


def test_markers_are_read_and_mistakes_in_them_named(tmp_path: Path) -> None:
    grid = MarkerGrid(9, 7, 0.0015, 0.0016, -2.0, 0.0001, 0.0, 0.0003)
    text = "".join(f"  {key}: {value}\n" for key, value in grid.to_dict().items())
    path = tmp_path / "mine.yaml"
    path.write_text(f"{DIGIT}\nmarkers:\n{text}")
    sensor = read_sensor(path)
    assert sensor == replace(Sensor(), marker_grid=grid)
    assert stored_sensor(sensor.to_dict(), 2) == sensor
    for right, wrong, message in (
        ("rows: 9", "rows: 0", "0 x 7 are not 1 to 1000"),
        ("rows: 9", "rows: 9.5", "markers.rows is 9.5. It must be a whole number"),
        ("row_pitch_m: 0.0015", "row_pitch_m: 0", "pitches and the dots' radius must be above 0"),
        ("dot_radius_m", "radius_m", "unknown key markers.radius_m. Did you mean markers.dot_radius_m?"),
    ):
        path.write_text(f"{DIGIT}\nmarkers:\n{text.replace(right, wrong)}")
        with pytest.raises(InputError, match=re.escape(message)):
            read_sensor(path)
    for key, value in (("rows", 10**6), ("rotation_deg", float("nan")), ("dot_radius_m", "x"), ("hue", 1)):
        values = sensor.to_dict()
        values["marker_grid"][key] = value
        with pytest.raises(FormatError, match=r"marker.grid"):
            stored_sensor(values, 2)
    with pytest.raises(FormatError, match=r"marker.grid"):
        stored_sensor({**sensor.to_dict(), "marker_grid": [1]}, 2)


def test_what_is_no_sensor_file_is_refused(subtests: pytest.Subtests, tmp_path: Path) -> None:
    for content in ["", "- a list", "gel: {", "\x00"]:
        with subtests.test(content=content):
            (tmp_path / "mine.yaml").write_text(content)
            with pytest.raises(InputError, match=r"mine\.yaml"):
                read_sensor(tmp_path / "mine.yaml")


@pytest.mark.parametrize("source", ["digits", "no/such.yaml", "README.md"])
def test_an_unknown_sensor_is_refused_with_those_known(source: str) -> None:
    with pytest.raises(InputError, match="Known: digit, digit-tacto, gelsight"):
        read_sensor(source)


def test_what_is_no_table_is_refused_by_file(subtests: pytest.Subtests, tmp_path: Path) -> None:
    for table, finding in [
        (None, "no photometric table"),
        (np.zeros((3, 2, 3, 5)), r"shape \(3, 2, 3, 5\)"),
        (np.full((3, 2, 3, 6), np.inf), "not finite"),
        (np.zeros((3, 2, 3, 6), dtype=int), "int64"),
        (np.arange(108.0).reshape(3, 2, 3, 6), "direction at slope 0"),
    ]:
        with subtests.test(table=table):
            if table is not None:
                np.save(tmp_path / "gelsight.npy", table)
            (tmp_path / "mine.yaml").write_text(GELSIGHT)
            with pytest.raises(InputError, match=finding) as caught:
                read_sensor(tmp_path / "mine.yaml")
            assert "gelsight.npy" in str(caught.value)


def test_a_table_of_lights_is_for_a_flat_gel(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(GELSIGHT.replace("sagitta_m: 0.0", "sagitta_m: 0.0001"))
    with pytest.raises(InputError, match=r"mine\.yaml: .*flat gel"):
        make_table(tmp_path / "mine.yaml")
    with pytest.raises(InputError, match=r"digit\.yaml: no section photometry\.made_from"):
        make_table("digit")
