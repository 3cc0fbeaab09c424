"""The ways to render a VisionNet, and which of them is taken."""

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.vision.incidence import UnitSurface
from objectfolder.vision.sparse_grid import SparseGrid

BACKENDS = ("reference",)


class Renderer(Protocol):
    """What every way answers; `reference_renderer.ReferenceRenderer` says shapes and units."""

    def render(
        self,
        camera_to_world: np.ndarray,
        light_position: np.ndarray,
        light_colour: np.ndarray,
        size: tuple[int, int],
        field_of_view_deg: float,
        sub_rays: int,
        crop: tuple[int, int, int, int] | None = None,
    ) -> np.ndarray:
        """Return the RGBA of a view."""
        ...

    def radiance(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        light_position: np.ndarray,
        light_colour: np.ndarray,
    ) -> np.ndarray:
        """Return RGBA along rays."""
        ...


def choose_backend(backend: str | None, device: str) -> str:
    """Return the name of the way to render on `device`; the fastest that is at hand if `backend` is None.

    Raises
    ------
    QueryError
        A name that is not known.
    """
    if backend is None:
        return "reference"
    if backend not in BACKENDS:
        raise QueryError("backend", f"{backend!r}", f"Use {' or '.join(map(repr, BACKENDS))}.")
    return backend


def make_renderer(
    backend: str,
    surface: UnitSurface,
    grid: SparseGrid,
    weights: Mapping[str, np.ndarray],
    radiance_scale: float,
    device: str,
) -> Renderer:
    """Return the renderer of that name; what it needs beside numpy is imported here."""
    from objectfolder.vision.reference_renderer import ReferenceRenderer

    return ReferenceRenderer(surface, grid, weights, radiance_scale, device)
