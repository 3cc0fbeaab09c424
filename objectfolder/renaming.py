"""Keywords of public functions under names that they had before: they work for one version, and warn."""

import functools
import warnings
from collections.abc import Callable
from typing import ParamSpec, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def renamed_keywords(
    **new_names: str,
) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Return a decorator that passes a keyword under its old name on under its new name, with a warning.

    Parameters
    ----------
    **new_names
        The new name of each old keyword. Type checkers see the new names alone.

    Raises
    ------
    TypeError
        A call that gives the same argument under both names.

    Examples
    --------
    >>> import warnings
    >>> from objectfolder.renaming import renamed_keywords
    >>> @renamed_keywords(duration="duration_s")
    ... def samples(duration_s, sample_rate_hz=44100):
    ...     return round(duration_s * sample_rate_hz)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     samples(duration=2.0), str(caught[0].message)
    (88200, 'samples: `duration` is now `duration_s`; the old name goes with 0.3')
    """

    def rename(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        @functools.wraps(function)
        def call(*arguments: Parameters.args, **keywords: Parameters.kwargs) -> Result:
            if not new_names.keys().isdisjoint(keywords):
                for old, new in new_names.items():
                    if old not in keywords:
                        continue
                    if new in keywords:
                        raise TypeError(f"{function.__name__}() got `{new}` and its old name `{old}`")
                    message = f"{function.__name__}: `{old}` is now `{new}`; the old name goes with 0.3"
                    warnings.warn(message, DeprecationWarning, stacklevel=2)
                    keywords[new] = keywords.pop(old)
            return function(*arguments, **keywords)

        return call

    return rename
