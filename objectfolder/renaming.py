"""Names and positions of arguments as they were before: they work for one version, and warn."""

import functools
import inspect
import sys
import warnings
from collections.abc import Callable
from types import FrameType
from typing import Any, ParamSpec, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
REMOVED_IN = "0.3"
INSIDE = (__name__, "objectfolder.lazy")


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
                        raise TypeError(f"{_name(function)}() got `{new}` and its old name `{old}`")
                    _warn(f"{_name(function)}: `{old}` is now `{new}`; the old name goes with {REMOVED_IN}")
                    keywords[new] = keywords.pop(old)
            return function(*arguments, **keywords)

        return call

    return rename


def formerly_positional(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Let a function take its keyword-only arguments by position still, with a warning.

    Examples
    --------
    >>> import warnings
    >>> from objectfolder.renaming import formerly_positional
    >>> @formerly_positional
    ... def samples(duration_s, *, sample_rate_hz=44100):
    ...     return round(duration_s * sample_rate_hz)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     samples(2.0, 1000), str(caught[0].message)
    (2000, 'samples: give `sample_rate_hz` by keyword; its position goes with 0.3')
    """
    kinds = [(name, parameter.kind) for name, parameter in inspect.signature(function).parameters.items()]
    keyword_only = [name for name, kind in kinds if kind is inspect.Parameter.KEYWORD_ONLY]
    positions = len(kinds) - len(keyword_only)

    @functools.wraps(function)
    def call(*arguments: Parameters.args, **keywords: Parameters.kwargs) -> Result:
        if len(arguments) <= positions:
            return function(*arguments, **keywords)
        for name, value in zip(keyword_only, arguments[positions:], strict=False):
            if name in keywords:
                raise TypeError(f"{_name(function)}() got `{name}` by keyword and by position")
            _warn(f"{_name(function)}: give `{name}` by keyword; its position goes with {REMOVED_IN}")
            keywords[name] = value
        if len(arguments) > len(kinds):
            raise TypeError(f"{_name(function)}() takes {len(kinds)} arguments, {len(arguments)} were given")
        return function(*arguments[:positions], **keywords)  # type: ignore[arg-type]

    return call


def renamed_attribute(new: str) -> Any:
    """Return a property that reads an attribute under its old name, with a warning."""

    def read(self: Any) -> Any:
        _warn(f"{type(self).__name__}: the attribute is now `{new}`; the old name goes with {REMOVED_IN}")
        return getattr(self, new)

    return property(read)


def warn_of_move(old: str, new: str) -> None:
    """Warn that a name is read where it was before."""
    _warn(f"{old} is now `{new}`; the old name goes with {REMOVED_IN}")


def _name(function: Callable[..., object]) -> str:
    return function.__qualname__.rpartition("<locals>.")[2].removesuffix(".__init__")


def _warn(message: str) -> None:
    """Warn of the first line outside of this module and of `lazy`: a function may have several decorators."""
    caller: FrameType | None = sys._getframe()
    level = 1
    while caller is not None and caller.f_globals.get("__name__") in INSIDE:
        level, caller = level + 1, caller.f_back
    warnings.warn(message, DeprecationWarning, stacklevel=level)
