"""Google Scanned Objects, as Gazebo Fuel serves them: a zip an object."""

from pathlib import Path
from typing import Any
from urllib.parse import quote

from pipeline.intake.sources.download import Downloader
from pipeline.intake.sources.http_client import AbsentError
from pipeline.intake.sources.source import Download, Source, obj_texture

FUEL = "https://fuel.gazebosim.org/1.0/GoogleResearch/"
APP = "https://app.gazebosim.org/GoogleResearch/fuel/"
VERSION = 1  # the first of a model: what is recorded of it stays true when another is published
PER_PAGE = 100
MOST_PAGES = 200
MESH = "meshes/model.obj"


class GoogleScannedObjects(Source):
    """The models of GoogleResearch on Gazebo Fuel."""

    id = "gso"
    title = "Google Scanned Objects"
    page = f"{APP}collections/Scanned%20Objects%20by%20Google%20Research"
    licence = "CC-BY-4.0"
    attribution = "Google Scanned Objects, Copyright 2020 Google LLC"
    addresses = (FUEL,)
    resolutions = ("original",)
    absent = f"The model is listed, but its version {VERSION} is not served. Try again later."

    def downloads(self, name: str, resolution: str, documents: Downloader) -> list[Download]:
        """Return the archive of an object, whose members lie at its top."""
        url_name = quote(name, safe="")
        return [Download(f"{FUEL}models/{url_name}/{VERSION}/{url_name}.zip", f"{name}.zip", top="")]

    def selects(self, path: str) -> bool:
        """Leave out the "._" twins of archives that were made on a Mac."""
        return not path.rpartition("/")[2].startswith("._")

    def mesh_and_texture(self, folder: Path, name: str, resolution: str) -> tuple[str, str | None]:
        """Return the mesh and its image, which does not lie where the mtl says."""
        return MESH, obj_texture(folder, MESH)

    def names(self, documents: Downloader) -> list[str]:
        """Return the names of all pages; past the last one the server answers that it is not there."""
        names: set[str] = set()
        for page in range(1, MOST_PAGES + 1):
            address = f"{FUEL}models?page={page}&per_page={PER_PAGE}"
            try:
                entries = documents.json(address, list[dict[str, Any]])
            except AbsentError:
                if page == 1:
                    raise
                break
            before = len(names)
            names |= {str(entry["name"]) for entry in entries if "name" in entry}
            if len(names) == before:  # a server that repeats its last page, or answers an empty one
                break
        return sorted(names)

    def object_page(self, name: str) -> str:
        """Return the page of a model."""
        return f"{APP}models/{quote(name, safe='')}"
