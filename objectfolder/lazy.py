"""Names of a package that are imported from its modules when they are first asked for."""

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

from objectfolder.renaming import warn_of_move


def lazy_names(
    package: str, modules: Mapping[str, Sequence[str]], moved: Mapping[str, Sequence[str]] | None = None
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the ``__getattr__`` and ``__dir__`` of a package whose names come from its modules.

    Importing the package imports none of these modules. The package states the same names under
    ``TYPE_CHECKING`` and in ``__all__``, where type checkers and editors read them.

    Parameters
    ----------
    package
        ``__name__`` of the package.
    modules
        Names that each module gives, by its dotted path inside the package.
    moved
        Names that were here and that another package gives now, by that package: they work for one version,
        and warn. Type checkers see them there alone.
    """
    origins = {name: f"{package}.{module}" for module, names in modules.items() for name in names}

    homes = {name: home for home, names in (moved or {}).items() for name in names}

    def get(name: str) -> Any:
        if name in homes:
            warn_of_move(f"{package}.{name}", f"{homes[name]}.{name}")
            return getattr(import_module(homes[name]), name)
        if name not in origins:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(origins[name]), name)
        setattr(sys.modules[package], name, value)  # asked once
        return value

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *origins})

    return get, names
