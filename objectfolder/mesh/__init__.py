"""From a file to a clean mesh of known length."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.mesh.ingest import ingest_object
    from objectfolder.mesh.mesh import TexturedMesh
    from objectfolder.mesh.readers.load import load_mesh
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "ingest": ["ingest_object"],
            "mesh": ["TexturedMesh"],
            "readers.load": ["load_mesh"],
        },
    )

__all__ = ["TexturedMesh", "ingest_object", "load_mesh"]
