"""ObjectFolder Factory: what an object looks, sounds and feels like, in one small file."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from objectfolder.object_file import ObjectFile

__version__ = "0.1.0"


def load(path: Path | str) -> "ObjectFile":
    """Open an Object File; see `objectfolder.object_file.ObjectFile`.

    Examples
    --------
    >>> import objectfolder
    >>> bar = objectfolder.load("bar.safetensors")
    >>> bar.description["object"]["name"], bar.description["material"]["name"]
    ('Glass bar', 'glass')
    """
    from objectfolder.object_file import ObjectFile

    return ObjectFile.load(path)
