"""Parts that other installed distributions bring: found by entry points, imported when they are asked for."""

import functools
import sys
from collections.abc import Collection
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from objectfolder.errors import InputError

SOURCE_GROUP = "objectfolder.sources"
SENSORS = "objectfolder.sensors"
SIMULATORS = "objectfolder.simulators"
EXPORTS = "objectfolder.exports"


@dataclass(frozen=True)
class Plugin:
    """A part of another distribution.

    Parameters
    ----------
    name
        Of its entry point.
    distribution, version
        What brings it.
    part
        What its entry point names.
    """

    name: str
    distribution: str
    version: str
    part: Any

    def error(self, finding: str, remedy: str) -> InputError:
        """Return an error that says which distribution is at fault."""
        return InputError(f"plugin {self.name!r} of {self.distribution} {self.version}", finding, remedy)


def plugin_names(group: str) -> list[str]:
    """Return the names of all parts of a group; nothing is imported."""
    return sorted({entry.name for entry in _entries(group, tuple(sys.path))})


def find_plugin(group: str, name: str, own: Collection[str]) -> Plugin | None:
    """Import the part of a name; None where no distribution brings one.

    Parameters
    ----------
    group
        Such as `SENSORS`.
    own
        Names of the project's own parts.

    Raises
    ------
    InputError
        Its import fails, or the name is also another's or the project's own.
    """
    entries = [entry for entry in _entries(group, tuple(sys.path)) if entry.name == name]
    if not entries:
        return None
    brought = [_distribution(entry) for entry in entries]
    if len(entries) > 1 or name in own:
        owners = [" ".join(release) for release in brought] + ["ObjectFolder Factory itself"] * (name in own)
        remedy = f"Uninstall one: pip uninstall {brought[0][0]}"
        raise InputError(f"{group}: {name!r}", f"is the name of parts of {' and of '.join(owners)}", remedy)
    distribution, version = brought[0]
    try:
        return Plugin(name, distribution, version, entries[0].load())
    except Exception as error:  # whatever the code of others raises as it is imported
        finding = f"cannot be imported from {entries[0].value} ({type(error).__name__}: {error})"
        remedy = f"Mend it, or: pip uninstall {distribution}"
        raise Plugin(name, distribution, version, None).error(finding, remedy) from error


@functools.cache
def _entries(group: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Return the entry points of a group, looked for once for each `sys.path`."""
    return tuple(entry_points(group=group))


def _distribution(entry: EntryPoint) -> tuple[str, str]:
    return (entry.dist.name, entry.dist.version) if entry.dist else (entry.module, "")
