"""YCB Object and Model Set: an archive an object and resolution, on a bucket of S3."""

import re
from pathlib import Path, PurePosixPath

from objectfolder.errors import FormatError
from pipeline.intake.sources.download import Downloader
from pipeline.intake.sources.obj_layout import obj_texture
from pipeline.intake.sources.source import Download, Source, check_file_name

BUCKET = "https://ycb-benchmarks.s3.amazonaws.com/data/"
RESOLUTIONS = ("google_16k", "google_64k", "google_512k")  # thousands of triangles of the Google scan
LIST = BUCKET + "objects.json"
# Other forms of the same mesh stand beside the one that is read; archives made on a Mac have "._" twins.
_WANTED = re.compile(r"(?!\._).*\.(obj|mtl|png|jpe?g|xml|txt)", re.IGNORECASE)


def downloads(name: str, resolution: str, documents: Downloader) -> list[Download]:
    """Return the archive of an object."""
    archive = f"{name}_{resolution}.tgz"
    return [Download(f"{BUCKET}google/{archive}", archive, top=name)]


def mesh_and_texture(folder: Path, name: str, resolution: str) -> tuple[str, str | None]:
    """Return the mesh and the image that its mtl names, with a space after it."""
    mesh = f"{resolution}/textured.obj"
    return mesh, obj_texture(folder, mesh)


def names(documents: Downloader) -> list[str]:
    """Return the names of the list, of which not all were scanned by Google."""
    listed = documents.json(LIST)
    found = listed.get("objects") if isinstance(listed, dict) else None
    if not isinstance(found, list) or not all(isinstance(name, str) for name in found):
        raise FormatError(LIST, "no list of objects", "Look at it in a browser, or use a mirror.")
    return sorted(found)


SOURCE = Source(
    id="ycb",
    title="YCB Object and Model Set",
    page="https://www.ycbbenchmarks.com",
    licence="CC-BY-4.0",
    attribution="YCB Object and Model Set, Calli et al. (ycbbenchmarks.com)",
    addresses=(BUCKET,),
    resolutions=RESOLUTIONS,
    downloads=downloads,
    wanted=lambda path: _WANTED.fullmatch(PurePosixPath(path).name) is not None,
    mesh_and_texture=mesh_and_texture,
    names=names,
    object_page=lambda name: f"{BUCKET}google/{name}_{RESOLUTIONS[0]}.tgz",
    absent="Google scanned only some of the YCB objects. Of all there should be "
    f"{BUCKET}berkeley/NAME/NAME_berkeley_meshes.tgz: unpack it, and `objectfolder add` a mesh of it.",
    check_name=lambda name: check_file_name(f"ycb:{name}", name),
)
