"""Functions that take the arguments of another, whose signature is written once."""

import inspect
from collections.abc import Callable
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, overload

Owner = TypeVar("Owner")
Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def same_arguments(
    method: Callable[Concatenate[Owner, Parameters], Any],
) -> Callable[[Callable[..., Result]], Callable[Concatenate[Owner, Parameters], Result]]:
    """Return a decorator that gives a method ``(self, *arguments, **keywords)`` the arguments of `method`.

    Type checkers and `help` then know them.
    """

    def decorate(function: Callable[..., Result]) -> Callable[Concatenate[Owner, Parameters], Result]:
        parameters = inspect.signature(method).parameters.values()
        returned = inspect.signature(function).return_annotation
        function.__signature__ = inspect.Signature(list(parameters), return_annotation=returned)  # type: ignore[attr-defined]
        return function

    return decorate


class ShortForm(Generic[Parameters, Result]):
    """A method of an attribute as a method of its owner: ``file.render`` is ``file.sight.render``.

    Parameters
    ----------
    attribute
        Name of the attribute.
    method
        Returns the method, of the attribute's class: asked for when it is needed, for the class may be in a
        module that is imported late.
    """

    def __init__(
        self, attribute: str, method: Callable[[], Callable[Concatenate[Any, Parameters], Result]]
    ) -> None:
        self._attribute = attribute
        self._method = method

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, owner: None, kind: type) -> Callable[Concatenate[Any, Parameters], Result]: ...
    @overload
    def __get__(self, owner: object, kind: type) -> Callable[Parameters, Result]: ...
    def __get__(self, owner: object | None, kind: type) -> Callable[..., Result]:
        if owner is None:
            return self._method()
        bound: Callable[..., Result] = getattr(getattr(owner, self._attribute), self._name)
        return bound
