"""YCB Object and Model Set: an archive an object and resolution, on a bucket of S3."""

import re
from pathlib import Path, PurePosixPath

from pydantic import BaseModel

from pipeline.intake.sources.download import Downloader
from pipeline.intake.sources.source import Download, Source, obj_texture

BUCKET = "https://ycb-benchmarks.s3.amazonaws.com/data/"
LIST = BUCKET + "objects.json"
# Other forms of the same mesh stand beside the one that is read; archives made on a Mac have "._" twins.
_MEMBERS = re.compile(r"(?!\._).*\.(obj|mtl|png|jpe?g|xml|txt)", re.IGNORECASE)


class _Listed(BaseModel):
    objects: list[str]


class YCB(Source):
    """The objects that Google scanned."""

    id = "ycb"
    title = "YCB Object and Model Set"
    page = "https://www.ycbbenchmarks.com"
    licence = "CC-BY-4.0"
    attribution = "YCB Object and Model Set, Calli et al. (ycbbenchmarks.com)"
    addresses = (BUCKET,)
    resolutions = ("google_16k", "google_64k", "google_512k")  # thousands of triangles
    absent = (
        "Google scanned only some of the YCB objects. Of all there should be "
        f"{BUCKET}berkeley/NAME/NAME_berkeley_meshes.tgz: unpack it, and `objectfolder add` a mesh of it."
    )

    def downloads(self, name: str, resolution: str, documents: Downloader) -> list[Download]:
        """Return the archive of an object."""
        archive = f"{name}_{resolution}.tgz"
        return [Download(f"{BUCKET}google/{archive}", archive, top=name)]

    def selects(self, path: str) -> bool:
        """Leave out the other forms of the mesh."""
        return _MEMBERS.fullmatch(PurePosixPath(path).name) is not None

    def mesh_and_texture(self, folder: Path, name: str, resolution: str) -> tuple[str, str | None]:
        """Return the mesh and the image that its mtl names, with a space after it."""
        mesh = f"{resolution}/textured.obj"
        return mesh, obj_texture(folder, mesh)

    def names(self, documents: Downloader) -> list[str]:
        """Return the names of the list, of which not all were scanned by Google."""
        return sorted(documents.json(LIST, _Listed).objects)

    def object_page(self, name: str) -> str:
        """Return the address of the archive: objects have no pages."""
        return f"{BUCKET}google/{name}_{self.resolutions[0]}.tgz"
