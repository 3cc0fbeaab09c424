"""A closed container, scanned from outside and therefore solid, made hollow."""

import numpy as np

from objectfolder.errors import InputError
from objectfolder.surface.signed_distance import surface_at_depth
from objectfolder.surface.surface import Surface

SHELL_REMEDY = "Correct shell_m, or leave it empty for a solid object"


def hollow(surface: Surface, shell_m: float, name: str = "surface", *, nodes: int = 200_000) -> Surface:
    """The surface with a cavity: all that is deeper inside than `shell_m`.

    The outside stays as it is. Wherever the object is thicker than twice the shell it becomes a wall of that
    thickness, and the wall is closed everywhere: what is scanned closed (a bottle with its cap, a can) is a
    closed hollow body. What is thinner than twice the shell (a handle) stays solid.

    Parameters
    ----------
    surface
        Metres, faces outward; closed or nearly so.
    shell_m
        Thickness of the wall in metres.
    name
        What to call the object in errors.
    nodes
        Of the grid that the cavity is found on.

    Returns
    -------
    Surface
        The faces of `surface`, followed by those of the cavity, which face into it.

    Raises
    ------
    InputError
        A thickness that is not positive, or as thick as the object: nothing of it is deep enough to be empty.
    """
    if not (np.isfinite(shell_m) and shell_m > 0):
        raise InputError(f"{name}, shell_m", f"{shell_m!r} is not a positive number of metres", SHELL_REMEDY)
    if 2 * shell_m >= float(np.ptp(surface.bounds, axis=0).min()):
        inner = None
    else:
        inner = surface_at_depth(surface, shell_m, nodes=nodes)
    if inner is None:
        raise InputError(
            f"{name}, shell_m",
            f"a shell of {shell_m:g} m leaves nothing hollow: the object is nowhere thick enough",
            SHELL_REMEDY,
        )
    used, packed = np.unique(inner.faces, return_inverse=True)
    return Surface(
        np.concatenate([surface.vertices, inner.vertices[used]]),
        np.concatenate([surface.faces, packed.reshape(-1, 3)[:, ::-1] + len(surface.vertices)]),
    )
