"""Old names and positions work with a warning; both names of one argument are an error."""

import inspect
import warnings

import pytest

from objectfolder.renaming import formerly_positional, renamed_attribute, renamed_keywords


@renamed_keywords(duration="duration_s", rate="sample_rate_hz")
def samples(duration_s: float, sample_rate_hz: float = 10.0) -> float:
    return duration_s * sample_rate_hz


def test_an_old_name_warns_and_counts():
    with pytest.warns(DeprecationWarning, match="`rate` is now `sample_rate_hz`") as caught:
        assert samples(2.0, rate=3.0) == 6.0  # type: ignore[call-arg]
    assert caught[0].filename == __file__, "the warning names the caller's line"


def test_new_names_and_positions_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert samples(2.0, sample_rate_hz=3.0) == samples(2.0, 3.0) == 6.0


def test_both_names_of_an_argument_are_refused():
    with pytest.raises(TypeError, match="`duration_s` and its old name `duration`"):
        samples(duration_s=1.0, duration=2.0)  # type: ignore[call-arg]


def test_help_shows_the_new_names_alone():
    assert list(inspect.signature(samples).parameters) == ["duration_s", "sample_rate_hz"]


@formerly_positional
def speed(distance_m: float, *, duration_s: float = 1.0, factor: float = 1.0) -> float:
    return factor * distance_m / duration_s


def test_an_old_position_warns_and_counts():
    with pytest.warns(DeprecationWarning, match="speed: give `duration_s` by keyword") as caught:
        assert speed(3.0, 2.0, factor=2.0) == 3.0  # type: ignore[misc]
    assert caught[0].filename == __file__
    with pytest.warns(DeprecationWarning, match="by keyword"), pytest.raises(TypeError, match="takes 3"):
        speed(3.0, 2.0, 1.0, 7.0)  # type: ignore[misc]
    with pytest.raises(TypeError, match="`duration_s` by keyword and by position"):
        speed(3.0, 2.0, duration_s=1.0)  # type: ignore[misc]


def test_two_decorators_name_the_line_that_calls():
    renamed = renamed_keywords(span="duration_s")(speed)
    with pytest.warns(DeprecationWarning, match="`span` is now `duration_s`") as caught:
        assert renamed(3.0, span=2.0) == 1.5  # type: ignore[call-arg]
    with pytest.warns(DeprecationWarning, match="give `duration_s` by keyword") as records:
        assert renamed(3.0, 2.0) == 1.5  # type: ignore[misc]
    assert [warning.filename for warning in [*caught, *records]] == [__file__] * 2


class Lamp:
    def __init__(self) -> None:
        self.colour = "red"

    color = renamed_attribute("colour")


def test_an_old_attribute_warns_and_is_read():
    with pytest.warns(DeprecationWarning, match="Lamp: the attribute is now `colour`"):
        assert Lamp().color == "red"
