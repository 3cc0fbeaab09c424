"""Objects as downloaded: served where their sources have them, fetched and ingested."""

import io
import os
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.surface.textured_mesh import textured_mesh_of
from pipeline.intake.sources.fetching import Fetched, Fetcher
from pipeline.intake.sources.recorded_hashes import read_hashes
from pipeline.intake.sources.registry import Resolutions
from tests.conftest import REPOSITORY
from tests.sources.served_sources import ServedSources, files_in

SPOON, MUG, CHAIR = "031_spoon", "ACE_Coffee_Mug_Kristen_16_oz_cup", "plastic_monobloc_chair_01"
SAMPLES = (f"ycb:{SPOON}", f"gso:{MUG}", f"polyhaven:{CHAIR}")
EXTENTS_M = {  # longest sides, measured on copies of the meshes from elsewhere
    f"ycb:{SPOON}": 0.18596,
    f"gso:{MUG}": 0.13494,
    f"polyhaven:{CHAIR}": 0.87984,
}


DOWNLOADS = Path(
    os.environ.get("OBJECTFOLDER_DOWNLOADS", REPOSITORY.parent / "shared" / "objects-as-downloaded")
)
THERE = (DOWNLOADS / f"{SPOON}_google_16k.tgz").is_file()


@pytest.fixture(scope="session")
def downloaded_samples() -> Path:
    """Folder of one object of each source as it was downloaded."""
    if not THERE:
        pytest.skip(
            f"no samples at {DOWNLOADS}; set OBJECTFOLDER_DOWNLOADS to a folder of objects as downloaded"
        )
    return DOWNLOADS


@pytest.fixture(scope="module")
def served_samples(downloaded_samples: Path, tmp_path_factory: pytest.TempPathFactory) -> ServedSources:
    sources = ServedSources(tmp_path_factory.mktemp("served"))
    sources.add_ycb(SPOON, archive=(downloaded_samples / f"{SPOON}_google_16k.tgz").read_bytes())
    sources.add_gso(MUG, archive=(downloaded_samples / f"{MUG}.zip").read_bytes())
    folder = downloaded_samples / f"{CHAIR}_1k"
    sources.add_poly_haven(CHAIR, files=files_in(folder))
    return sources


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Root of a data set."""
    return tmp_path_factory.mktemp("place")


@pytest.fixture(scope="module")
def fetched_samples(served_samples: ServedSources, place: Path) -> Iterator[dict[str, Fetched]]:
    """The three, fetched against the hashes that the project knows."""
    hashes = place / "data" / "source_hashes.csv"
    hashes.parent.mkdir()
    hashes.write_bytes((REPOSITORY / "data" / "source_hashes.csv").read_bytes())
    with served_samples.server.listening() as base:
        fetcher = Fetcher(
            place / "data" / "fetched", served_samples.downloader(base, place / "cache"), hashes
        )
        yield {source_id: fetcher.fetch(Resolutions().source_object(source_id)) for source_id in SAMPLES}


@pytest.mark.parametrize("source_id", SAMPLES)
def test_bytes_are_those_of_the_originals(fetched_samples, served_samples, downloaded_samples, source_id):
    got = fetched_samples[source_id]
    assert files_in(got.folder) == served_samples.expected[source_id]
    if source_id.startswith("polyhaven"):
        original = downloaded_samples / f"{CHAIR}_1k"
        assert got.mesh.read_bytes() == (original / f"{CHAIR}_1k.gltf").read_bytes()
        texture = f"textures/{CHAIR}_diff_1k.jpg"
        assert (got.folder / texture).read_bytes() == (original / texture).read_bytes()
        return
    assert got.texture is not None
    if source_id.startswith("ycb"):
        with tarfile.open(downloaded_samples / f"{SPOON}_google_16k.tgz") as archive:
            for path in (got.mesh, got.texture):
                member = archive.extractfile(f"{SPOON}/{path.relative_to(got.folder)}")
                assert member is not None
                assert path.read_bytes() == member.read()
    else:
        content = io.BytesIO((downloaded_samples / f"{MUG}.zip").read_bytes())
        with zipfile.ZipFile(content) as archive:
            for path in (got.mesh, got.texture):
                assert path.read_bytes() == archive.read(path.relative_to(got.folder).as_posix())


def test_what_the_project_knows_of_them_holds(fetched_samples):
    """All files but the texture of the mug, of which the sample is a smaller copy."""
    hashes = read_hashes(REPOSITORY / "data" / "source_hashes.csv")
    new = {
        (source_id, path)
        for source_id, got in fetched_samples.items()
        for path in got.form.files
        if (source_id, path) not in hashes
    }
    assert new == {(f"gso:{MUG}", "materials/textures/texture.png")}
    assert {got.recorded for got in fetched_samples.values()} == {0, 1}


@pytest.mark.parametrize("source_id", SAMPLES)
def test_they_are_ingested_in_metres_with_their_colours(fetched_samples, source_id):
    got = fetched_samples[source_id]
    product = ingest_object(got.mesh, texture_path=got.texture, object_id=source_id)
    longest = max(product.attributes["length"]["extents_m"])
    assert longest == pytest.approx(EXTENTS_M[source_id], abs=1e-5)
    (image, *_) = textured_mesh_of(product).textures
    assert min(image.shape[:2]) >= 1024
