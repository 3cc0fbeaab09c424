"""A question before an object is built whose size is probably a mistake of unit."""

import sys
from typing import TYPE_CHECKING

from objectfolder.errors import InputError
from pipeline.run.doubtful_size import size_doubts

if TYPE_CHECKING:
    from objectfolder.audio.materials import Material
    from pipeline.run.single_build import Building


def confirm_size(building: "Building", material: "Material") -> None:
    """Ask on a terminal whether a doubtful size is meant; elsewhere refuse it.

    Raises
    ------
    InputError
        A doubtful size (`size_doubts`) that nobody confirms.
    """
    doubts = size_doubts(building, material)
    if not doubts:
        return
    finding = " and ".join(doubts)
    if sys.stdin.isatty() and sys.stderr.isatty():
        print(f"{building.mesh}: {finding}. Build it? [y/N] ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            return
    remedy = "State --length in metres" if building.length_m is None else "Correct --length or --material"
    raise InputError(str(building.mesh), finding, f"{remedy}, or give --yes.")
