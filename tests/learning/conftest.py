"""A data set of twins, small enough for every task of learning."""

from pathlib import Path

import pytest

import objectfolder
from learning.grasping import worlds
from learning.grasping.world import PARTS, World, least_force_n
from learning.settings import Counts, Sides, read_settings
from objectfolder import example
from objectfolder.simulators.collision import convex_parts

EXAMPLES = Path(objectfolder.__file__).parent / "examples"
PARAMETERS = Path(__file__).parents[2] / "learning" / "params.yaml"


@pytest.fixture(scope="session")
def tiny(small_file, tmp_path_factory):
    """Four names of one object: nobody can tell them apart."""
    root = tmp_path_factory.mktemp("twins")
    (root / "data" / "object_files").mkdir(parents=True)
    for name in "abcd":
        (root / "data" / "object_files" / f"{name}.safetensors").symlink_to(small_file)
    settings = read_settings(PARAMETERS)
    return settings.model_copy(
        update={
            "seeds": (0,),
            "data": settings.data.model_copy(
                update={
                    "root": str(root),
                    "validation": 4,
                    "test": 6,
                    "training": Counts(vision=6, audio=5, touch=7),
                    "resolution": Sides(vision=16, audio=16, touch=16),
                }
            ),
            "encoder": settings.encoder.model_copy(update={"width": 8, "epochs": 1}),
            "retrieval": settings.retrieval.model_copy(update={"epochs": 1, "dimensions": 4}),
            "reconstruction": settings.reconstruction.model_copy(
                update={"steps": 5, "points": 32, "width": 8, "grid": 16, "tests": 1, "surface_points": 200}
            ),
            "grasping": settings.grasping.model_copy(
                update={"grasps": 8, "resolution": 16, "sizes": (16,), "folds": 2}
            ),
            "regrasping": settings.regrasping.model_copy(
                update={"seeds": (0,), "rollouts": 2, "rollout_steps": 16, "fixed_episodes": 1, "episodes": 8}
            ),
        }
    )


@pytest.fixture(scope="session")
def held():
    """A mug, and the force of thrice its weight's."""
    file = example("mug")
    hulls = convex_parts(file.surface, most_parts=PARTS, name="mug").hulls
    return {"mug": World(file, hulls)}, {"mug": 3 * least_force_n(file)}


@pytest.fixture
def mugs(unparted_mugs, held, monkeypatch):
    """The same, whose parts are known."""
    monkeypatch.setattr(worlds, "_parts", lambda path, digest: [])
    monkeypatch.setattr(worlds, "world_at", lambda path, digest: held[0]["mug"])
    return unparted_mugs


@pytest.fixture
def unparted_mugs(tiny, tmp_path):
    """Settings of a data set of one mug by four names."""
    folder = tmp_path / "data" / "object_files"
    folder.mkdir(parents=True)
    for name in "abcd":
        (folder / f"{name}.safetensors").symlink_to(EXAMPLES / "mug.safetensors")
    return tiny.model_copy(update={"data": tiny.data.model_copy(update={"root": str(tmp_path)})})
