"""The entry point by which `objectfolder.build` reaches the factory."""

import warnings
from pathlib import Path
from typing import Any

from pipeline.run.single_build import Building, build_object_file


def build(mesh: Path, output: Path, **description: Any) -> None:
    """Build an Object File, and warn of what is doubtful about the object's walls and mass.

    Parameters
    ----------
    mesh, output
        Files.
    **description
        Fields of `Building`.
    """
    _, findings = build_object_file(Building(mesh, **description), output)
    for finding in findings:
        warnings.warn(str(finding), stacklevel=4)  # at the caller of `objectfolder.build`
