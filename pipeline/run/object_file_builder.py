"""The entry point by which `objectfolder.build` reaches the factory."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from objectfolder.errors import InputError
from pipeline.run.doubtful_size import doubts_before_building, size_remedy
from pipeline.run.single_build import Building, build_object_file

if TYPE_CHECKING:
    from objectfolder.audio.materials import Material


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
        Build also an object whose size is doubtful (`doubts_before_building`).
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
    built = build_object_file(
        Building(mesh, **description), output, None if any_size else _refuse_doubtful_size
    )
    for warning in built.warnings:
        warnings.warn(warning, stacklevel=4)  # at the caller of `objectfolder.build`


def _refuse_doubtful_size(building: Building, material: "Material") -> None:
    if doubts := doubts_before_building(building, material):
        remedy = size_remedy(building, "length_m", "mass_kg", "material")
        raise InputError(str(building.mesh), "; ".join(doubts), f"{remedy}, or give any_size=True.")
