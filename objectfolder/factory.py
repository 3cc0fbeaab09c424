"""The factory as the library reaches it: by an entry point, since the library imports no pipeline."""

from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError

GROUP, NAME = "objectfolder.builders", "object_file"
REMEDY = 'Install the factory: pip install "objectfolder-factory[factory]".'


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
    InputError
        No factory is installed, or a package that it needs is not.
    """
    builders = entry_points(group=GROUP, name=NAME)
    if not builders:
        raise InputError("build", "the factory is not installed", REMEDY)
    try:
        builders[NAME].load()(mesh, output, **description)
    except ModuleNotFoundError as error:
        raise InputError("build", f"{error.name} is not installed", REMEDY) from error
