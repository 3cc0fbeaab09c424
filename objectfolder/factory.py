"""The factory as the library reaches it: by an entry point, since the library imports no pipeline."""

from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from objectfolder.extras import missing_package, needs_extra

ENTRY_POINTS, NAME, EXTRA = "objectfolder.builders", "object_file", "factory"


def build_object_file(mesh: Path, output: Path, **description: Any) -> None:
    """Build an Object File with the installed factory.

    Parameters
    ----------
    mesh, output
        Files.
    **description
        What is known of the object, as `objectfolder.build` takes it.

    Raises
    ------
    MissingPackageError
        No factory is installed, or a package that it needs is not.
    """
    builders = entry_points(group=ENTRY_POINTS, name=NAME)
    if not builders:
        raise missing_package("the factory", EXTRA)
    with needs_extra(EXTRA):
        builders[NAME].load()(mesh, output, **description)
