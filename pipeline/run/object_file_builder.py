"""The entry point by which `objectfolder.build` reaches the factory."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from objectfolder.errors import InputError
from pipeline.run.doubtful_size import size_doubts
from pipeline.run.single_build import Building, build_object_file

if TYPE_CHECKING:
    from objectfolder.audio.materials import Material


def build(
    mesh: Path, output: Path, *, overwrite: bool = False, any_size: bool = False, **description: Any
) -> None:
    """Build an Object File, and warn of what is doubtful about the object's walls and mass.

    Parameters
    ----------
    mesh, output
        Files.
    overwrite
        Replace an `output` that is there already.
    any_size
        Build also an object whose size is doubtful (`size_doubts`).
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
    _, findings = build_object_file(
        Building(mesh, **description), output, None if any_size else _refuse_doubtful_size
    )
    for finding in findings:
        warnings.warn(str(finding), stacklevel=4)  # at the caller of `objectfolder.build`


def _refuse_doubtful_size(building: Building, material: "Material") -> None:
    if doubts := size_doubts(building, material):
        remedy = "State length_m in metres" if building.length_m is None else "Correct length_m or material"
        raise InputError(str(building.mesh), " and ".join(doubts), f"{remedy}, or give any_size=True.")
