"""A question before an object is built whose size is probably a mistake of unit."""

import sys
from typing import TYPE_CHECKING

from objectfolder.errors import InputError
from pipeline.run.doubtful_size import doubts_before_building, size_remedy

if TYPE_CHECKING:
    from objectfolder.audio.materials import Material
    from pipeline.run.single_build import Building


def confirm_size(building: "Building", material: "Material") -> None:
    """Ask on a terminal whether a doubtful size is meant; elsewhere refuse it.

    Raises
    ------
    InputError
        A doubtful size (`doubts_before_building`) that nobody confirms.
    """
    doubts = doubts_before_building(building, material)
    if not doubts:
        return
    finding = "; ".join(doubts)
    if sys.stdin.isatty() and sys.stderr.isatty():
        print(f"{building.mesh}: {finding}. Build it? [y/N] ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            return
    remedy = size_remedy(building, "--length", "--mass", "--material")
    raise InputError(str(building.mesh), finding, f"{remedy}, or give --yes.")
