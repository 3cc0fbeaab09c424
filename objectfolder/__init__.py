"""ObjectFolder Factory: what an object looks, sounds and feels like, in one small file.

>>> import objectfolder
>>> mug = objectfolder.load("025_mug.safetensors")   # doctest: +SKIP
>>> images = mug.render(*mug.sample_views(4, seed=0))  # doctest: +SKIP
"""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from objectfolder.object_file import ObjectFile

__version__ = "0.1.0"


def load(path: Path | str) -> "ObjectFile":
    """Open an Object File; see `objectfolder.object_file.ObjectFile`."""
    from objectfolder.object_file import ObjectFile

    return ObjectFile.load(path)
