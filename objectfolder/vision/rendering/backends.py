"""The ways to render a VisionNet, and which of them is taken."""

import importlib.util
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from objectfolder.errors import QueryError
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.sparse_grid import SparseGrid

BACKENDS = ("compiled", "reference")


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
    """Return the name of the way to render on `device`.

    Parameters
    ----------
    backend
        ``"compiled"``, kernels compiled by numba, on the CPU; ``"reference"``, numpy and torch, anywhere.
        None stands for the first where it can be had, else for the second.

    Raises
    ------
    QueryError
        A name that is not known, or a way that is not at hand.
    """
    compiles = all(importlib.util.find_spec(name) is not None for name in ("numba", "scipy"))
    if backend is None:
        return "compiled" if device == "cpu" and compiles else "reference"
    if backend not in BACKENDS:
        raise QueryError("backend", f"{backend!r}", f"Use {' or '.join(map(repr, BACKENDS))}.")
    if backend == "compiled" and device != "cpu":
        raise QueryError("backend", f"'compiled' renders on the CPU, not on {device}", "Use 'reference'.")
    if backend == "compiled" and not compiles:
        raise QueryError("backend", "'compiled' needs numba and scipy", "Install them, or use 'reference'.")
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
    if backend == "compiled":
        from objectfolder.vision.compiled import CompiledRenderer

        return CompiledRenderer(surface, grid, weights, radiance_scale)
    from objectfolder.vision.rendering.reference_renderer import ReferenceRenderer

    return ReferenceRenderer(surface, grid, weights, radiance_scale, device)
