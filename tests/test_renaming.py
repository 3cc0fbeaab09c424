"""Old names of keywords work with a warning; both names of one argument are an error."""

import inspect
import warnings

import pytest

from objectfolder.renaming import renamed_keywords


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
