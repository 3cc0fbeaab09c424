"""A closed surface, its compressed form, and its frames."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.surface.surface import Surface
    from objectfolder.surface.textured_mesh import TexturedMesh
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "surface": ["Surface"],
            "textured_mesh": ["TexturedMesh"],
        },
    )

__all__ = ["Surface", "TexturedMesh"]
