"""ObjectFolder Factory: what an object looks, sounds and feels like, in one small file."""

from pathlib import Path
from typing import TYPE_CHECKING

from objectfolder.instructions import choose_blas_kernel
from objectfolder.lazy import lazy_names

choose_blas_kernel()  # before anything imports NumPy
if TYPE_CHECKING:
    from objectfolder.audio.synthesis.sound import Sound
    from objectfolder.errors import (
        FormatError,
        InputError,
        MissingPackageError,
        ObjectFolderError,
        QueryError,
        SimulationError,
        UnsolvableError,
    )
    from objectfolder.object_file.object_file import ObjectFile
    from objectfolder.touch.presses.touches import Press, Touches
    from objectfolder.vision.environment import Environment
    from objectfolder.vision.lamps import Lamps
else:
    __getattr__, _ = lazy_names(
        __name__,
        {
            "audio.synthesis.sound": ["Sound"],
            "errors": [
                "FormatError",
                "InputError",
                "MissingPackageError",
                "ObjectFolderError",
                "QueryError",
                "SimulationError",
                "UnsolvableError",
            ],
            "object_file.object_file": ["ObjectFile"],
            "touch.presses.touches": ["Press", "Touches"],
            "vision.environment": ["Environment"],
            "vision.lamps": ["Lamps"],
        },
    )

__version__ = "0.1.0"
__all__ = [
    "Environment",
    "FormatError",
    "InputError",
    "Lamps",
    "MissingPackageError",
    "ObjectFile",
    "ObjectFolderError",
    "Press",
    "QueryError",
    "SimulationError",
    "Sound",
    "Touches",
    "UnsolvableError",
    "build",
    "example",
    "load",
]
EXAMPLES = Path(__file__).with_name("examples")


def __dir__() -> list[str]:
    return sorted(__all__)


def load(path: Path | str) -> "ObjectFile":
    """Open an Object File; see `ObjectFile`.

    Raises
    ------
    FormatError
        A truncated or foreign file or a folder, an unknown version, or a tensor of a wrong shape.
    FileNotFoundError
        No such file.

    Examples
    --------
    >>> import objectfolder
    >>> bar = objectfolder.load("bar.safetensors")
    >>> bar.name, bar.material
    ('Glass bar', 'glass')
    """
    from objectfolder.object_file import ObjectFile

    return ObjectFile.load(path)


def example(name: str = "mug") -> "ObjectFile":
    """Open an Object File of this package: ``"mug"``, ``"bell"``, ``"bowl"`` or ``"plate"``.

    Raises
    ------
    QueryError
        Another name.

    Examples
    --------
    >>> import objectfolder
    >>> objectfolder.example("mug")
    ObjectFile('Mug with a handle', ceramic, 0.286 kg, 11.8 x 8.2 x 9.5 cm, 44 modes)
    """
    names = sorted(path.stem for path in EXAMPLES.glob("*.safetensors"))
    if name not in names:
        from objectfolder.errors import QueryError

        raise QueryError("name", f"{name!r} is no example", f"Use {' or '.join(names)}.")
    return load(EXAMPLES / f"{name}.safetensors")


def build(
    mesh: Path | str,
    *,
    material: str,
    length_m: float | None = None,
    output: Path | str,
    name: str | None = None,
    texture: Path | str | None = None,
    wall_m: float | None = None,
    shell_m: float | None = None,
    mass_kg: float | None = None,
    glass: str = "opaque",
    up: str | None = None,
    decimate: int | None = None,
    silent: bool = False,
    overwrite: bool = False,
    any_size: bool = False,
) -> "ObjectFile":
    """Make one verified Object File from a mesh, a material and a size: ``objectfolder build`` in Python.

    It takes minutes, and the packages of the factory: ``pip install "objectfolder-factory[factory]"``.

    Parameters
    ----------
    mesh
        OBJ, glTF, GLB, PLY, STL, OFF, 3MF, COLLADA, FBX, USD or .blend.
    material
        A row of the factory's table of materials, such as ``"ceramic"``.
    length_m
        Longest side, metres; as in the file if None.
    output
        The Object File, ``.safetensors``.
    name
        In words; from the file's name if None.
    texture
        Image of the base colour; the mesh's own if None.
    wall_m, shell_m
        Least thickness of walls where a scan fused them, and the wall of a container that was scanned solid,
        metres.
    glass
        ``"thin"``: light passes the walls, as through a slab each; ``"opaque"``: none does.
    mass_kg
        The mass where it is known, as a check and for simulators.
    up
        Axis of the mesh that is up, ``"x"``, ``"y"`` or ``"z"``; y for glTF and z for all others if None.
    decimate
        At most this many faces: edges of a mesh that has more are collapsed, and the distance is warned of.
    silent
        Leave sound out.
    overwrite
        Replace a file that is there already.
    any_size
        Build also an object of a doubtful size, such as 1 m or more by its file without `length_m`, or above
        100 kg: mostly a mistake of unit.

    Returns
    -------
    ObjectFile
        As saved at `output`. What is doubtful about the object is warned of.

    Raises
    ------
    InputError
        A mesh, a material, a length or a name that cannot be used; a file that is there already; a doubtful
        size.
    MissingPackageError
        The factory, or a package that it needs, is not installed.
    SimulationError
        A stage that failed, with its error and remedy.

    Examples
    --------
    >>> import objectfolder
    >>> objectfolder.build("bar.obj", material="paper", output="bar.safetensors")
    Traceback (most recent call last):
    objectfolder.errors.InputError: ...
    """
    from objectfolder.factory import build_object_file

    build_object_file(
        Path(mesh),
        Path(output),
        material=material,
        length_m=length_m,
        name=name,
        texture=None if texture is None else Path(texture),
        wall_m=wall_m,
        shell_m=shell_m,
        mass_kg=mass_kg,
        glass=glass,
        up=up,
        decimate=decimate,
        silent=silent,
        overwrite=overwrite,
        any_size=any_size,
    )
    return load(output)
