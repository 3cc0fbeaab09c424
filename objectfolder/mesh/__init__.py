"""Names that were here: meshes are read by `objectfolder.making`, and held by `objectfolder.surface`."""

from objectfolder.lazy import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {},
    {"objectfolder.making": ["ingest_object", "load_mesh"], "objectfolder.surface": ["TexturedMesh"]},
)

__all__: list[str] = []
