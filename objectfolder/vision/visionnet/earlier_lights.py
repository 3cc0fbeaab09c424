"""Light, passes and linear images as earlier arguments of `render`: they work for one version, and warn."""

import functools
import warnings
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

from objectfolder.errors import QueryError
from objectfolder.vision.environment import Environment
from objectfolder.vision.lamps import Lamps

Owner = TypeVar("Owner")
Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
SUCCESSORS = {
    "light_position": "`lights`",
    "light": "`lights`",
    "light_colour": "`lights=Lamps(positions_m, colours)`",
    "linear": "the method `render_linear`",
    "passes": "the method `render_passes`",
}


def earlier_lights(
    *order: str,
    stacklevel: int = 2,
) -> Callable[
    [Callable[Concatenate[Owner, Parameters], Result]], Callable[Concatenate[Owner, Parameters], Result]
]:
    """Return a decorator of a method that passes its earlier arguments on as the present ones.

    Parameters
    ----------
    *order
        Names of the earlier positional arguments, those that have a new name under it.
    stacklevel
        Of the warning, as for `warnings.warn`: 3 below another decorator.
    """

    def decorate(
        method: Callable[Concatenate[Owner, Parameters], Result],
    ) -> Callable[Concatenate[Owner, Parameters], Result]:
        @functools.wraps(method)
        def call(owner: Owner, *arguments: Parameters.args, **keywords: Parameters.kwargs) -> Result:
            options: dict[str, Any] = dict(zip(order, arguments, strict=False)) | keywords
            earlier = [name for name in SUCCESSORS if name in options]
            if not earlier:
                return method(owner, *arguments, **keywords)
            successors = " and ".join(dict.fromkeys(SUCCESSORS[name] for name in earlier))
            message = f"{method.__name__}: use {successors} in place of {', '.join(earlier)}"
            warnings.warn(f"{message}; the old way goes with 0.3", DeprecationWarning, stacklevel=stacklevel)
            positions = options.pop("light_position", None)
            options["lights"] = _lights(
                options.get("lights") if positions is None else positions,
                options.pop("light", None),
                options.pop("light_colour", None),
            )
            linear, passes = options.pop("linear", False), options.pop("passes", None)
            if passes is None:
                return cast(
                    "Result", getattr(owner, "render_linear" if linear else method.__name__)(**options)
                )
            names = ["linear" if linear and name == "image" else name for name in passes]
            drawn = cast("Any", owner).render_passes(passes=names, **options)
            return cast("Result", {name: drawn[now] for name, now in zip(passes, names, strict=True)})

        return call

    return decorate


def _lights(positions: Any, light: Any, colours: Any) -> Any:
    """Return one `lights` of the three arguments that there were."""
    if light is None:
        return positions if colours is None else Lamps(positions, colours)
    if positions is not None or colours is not None:
        remedy = "Give lamps, with their colours or without, or one light for all views."
        raise QueryError("lights", "lamps beside light from all round", remedy)
    return light if isinstance(light, str) else Environment.of(light)
