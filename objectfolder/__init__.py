"""ObjectFolder Factory: what an object looks, sounds and feels like, in one small file."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from objectfolder.object_file import ObjectFile

__version__ = "0.1.0"
EXAMPLES = Path(__file__).with_name("examples")


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


def example(name: str = "mug") -> "ObjectFile":
    """Open an Object File of this package: ``"mug"`` or ``"bell"``.

    Raises
    ------
    QueryError
        Another name.

    Examples
    --------
    >>> import objectfolder
    >>> mug = objectfolder.example("mug")
    >>> mug.description["material"]["name"], len(mug.modes.frequencies_hz)
    ('ceramic', 44)
    """
    known = sorted(path.stem for path in EXAMPLES.glob("*.safetensors"))
    if name not in known:
        from objectfolder.errors import QueryError

        raise QueryError("name", f"{name!r} is no example", f"Use {' or '.join(known)}.")
    return load(EXAMPLES / f"{name}.safetensors")
