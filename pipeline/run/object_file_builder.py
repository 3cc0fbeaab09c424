"""The entry point by which `objectfolder.build` reaches the factory."""

import warnings
from functools import partial
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from pipeline.run.doubtful_size import CALL, refuse_doubtful_size
from pipeline.run.single_build import Building, build_object_file


def build(
    mesh: Path, output: Path, *, overwrite: bool = False, any_size: bool = False, **description: Any
) -> None:
    """Build an Object File, and warn of what is doubtful about the object.

    Parameters
    ----------
    mesh, output
        Files.
    overwrite
        Replace an `output` that is there already.
    any_size
        Build also an object whose size is doubtful (`refuse_doubtful_size`).
    **description
        Fields of `Building`.

    Raises
    ------
    InputError
        A file that may not be replaced, or a doubtful size.
    """
    if output.is_dir():
        raise InputError(str(output), "is a folder", "Name a file.")
    if output.exists() and not overwrite:
        raise InputError(str(output), "is there already", "Name another file, or give overwrite=True.")
    confirm = None if any_size else partial(refuse_doubtful_size, words=CALL)
    result = build_object_file(Building(mesh, **description), output, confirm)
    for warning in result.warnings:
        warnings.warn(warning, stacklevel=4)  # at the caller of `objectfolder.build`
