"""An object as its owner gives it to the cleaned, measured mesh that every sense starts from."""

from pathlib import Path

from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.products.store import Product
from pipeline.dataset.task import Request


def prepare_object(request: Request) -> Product:
    """Clean, scale and measure one object (see `objectfolder.making.mesh.ingest.ingest_object`)."""
    texture: Path | None = request.inputs.get("texture")
    return ingest_object(
        request.inputs["mesh"],
        texture_path=texture,
        length_m=request.record["length_m"],
        object_id=request.object_id,
        up=request.record.get("up"),  # records of earlier versions have none
    )
