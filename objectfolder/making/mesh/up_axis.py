"""Which axis of a file is up: that axis becomes z, which cameras, lights and simulators take as up."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.products.regular_file import open_regular
from objectfolder.surface.textured_mesh import TexturedMesh

Z_UP = "z"

_AXES = {"x": (1, 2, 0), "y": (0, 2, 1), Z_UP: (0, 1, 2)}
"""By the axis that is up, which axis of the file becomes x, y and z."""

_SIGNS = {"x": (1.0, 1.0, 1.0), "y": (1.0, -1.0, 1.0), Z_UP: (1.0, 1.0, 1.0)}

UP_AXES = tuple(_AXES)

_COLLADA_UP = re.compile(rb"up_axis\s*>\s*([XYZ])_UP")

_HEAD_BYTES = 2**16


def up_axis(path: Path) -> str:
    """Return the axis that is up by a file's format: y for glTF, what a COLLADA file says, else z.

    Blender gives what it reads z as up, by what FBX and USD files say.
    """
    suffix = path.suffix.lower()
    if suffix == ".dae":
        with open_regular(path) as file:
            statement = _COLLADA_UP.search(file.read(_HEAD_BYTES))
        return statement[1].decode().lower() if statement else "y"
    return "y" if suffix in (".gltf", ".glb") else Z_UP


def check_up_axis(up: str | None, where: str) -> None:
    """Raise `InputError` for what is neither an axis nor None."""
    if up is not None and up not in UP_AXES:
        raise InputError(where, f"{up!r} is no axis", f"Use one of {', '.join(UP_AXES)}")


def z_up(mesh: TexturedMesh, up: str) -> TexturedMesh:
    """Turn a mesh so that its axis `up` becomes z: a rotation by quarters, which rounds nothing.

    From y it is Blender's: (x, y, z) becomes (x, -z, y).
    """
    if up == Z_UP:
        return mesh
    axes, signs = list(_AXES[up]), np.array(_SIGNS[up])
    return replace(
        mesh,
        vertices=mesh.vertices[:, axes] * signs + 0.0,
        normals=None if mesh.normals is None else mesh.normals[..., axes] * signs,
    )
