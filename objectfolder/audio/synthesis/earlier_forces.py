"""Impulses and forces in one argument, as `strike` took them before; it works for one version, and warns."""

import functools
import warnings
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np

Owner = TypeVar("Owner")
Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def earlier_forces(
    earlier: str, impulse: str, force: str, dimensions: int, stacklevel: int = 2
) -> Callable[
    [Callable[Concatenate[Owner, Parameters], Result]], Callable[Concatenate[Owner, Parameters], Result]
]:
    """Return a decorator of a method ``(points, impulse, ...)`` that had one argument for both.

    Parameters
    ----------
    earlier, impulse, force
        Its name, and the present names.
    dimensions
        Of an array of forces; one of impulses has fewer.
    stacklevel
        Of the warning, as for `warnings.warn`: 3 below another decorator.
    """

    def decorate(
        method: Callable[Concatenate[Owner, Parameters], Result],
    ) -> Callable[Concatenate[Owner, Parameters], Result]:
        @functools.wraps(method)
        def call(owner: Owner, *arguments: Parameters.args, **keywords: Parameters.kwargs) -> Result:
            positional = arguments[1] if len(arguments) > 1 else None
            sampled = isinstance(positional, np.ndarray | list) and np.ndim(positional) == dimensions
            if earlier not in keywords and not sampled:
                return method(owner, *arguments, **keywords)
            options: dict[str, Any] = dict(keywords)
            value = options.pop(earlier, positional)
            now = force if np.ndim(value) == dimensions else impulse
            places: Any = (*arguments[:1], None, *arguments[2:]) if sampled else arguments
            message = f"{method.__name__}: give `{now}`, not `{earlier}`; the old way goes with 0.3"
            warnings.warn(message, DeprecationWarning, stacklevel=stacklevel)
            return method(owner, *places, **{now: value}, **options)

        return call

    return decorate
