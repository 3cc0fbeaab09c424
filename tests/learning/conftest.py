"""Data sets small enough for every task of learning."""

from pathlib import Path

import pytest
import trimesh

import objectfolder
from learning.grasping import worlds
from learning.grasping.world import World, least_force_n
from learning.settings import Counts, Sides, read_settings
from objectfolder import example, load
from objectfolder.object_file import ObjectFile
from objectfolder.surface.surface import Surface

EXAMPLES = Path(objectfolder.__file__).parent / "examples"
PARAMETERS = Path(__file__).parents[2] / "learning" / "params.yaml"


@pytest.fixture(autouse=True)
def _no_log_in_the_temporary_folder(tmp_path_factory, monkeypatch):
    """Where Stable-Baselines3 logs, nobody looks."""
    monkeypatch.setenv("SB3_LOGDIR", str(tmp_path_factory.getbasetemp() / "sb3"))


def at_root(settings, root):
    """Settings of a data set elsewhere."""
    return settings.model_copy(update={"data": settings.data.model_copy(update={"root": str(root)})})


def set_of(folder, paths):
    """Make a data set of Object Files by their names, and return its root."""
    (folder / "data" / "object_files").mkdir(parents=True)
    for name, path in paths.items():
        (folder / "data" / "object_files" / f"{name}.safetensors").symlink_to(path)
    return folder


@pytest.fixture(scope="session")
def tiny(small_file, tmp_path_factory):
    """Four names of one object: nobody can tell them apart."""
    root = set_of(tmp_path_factory.mktemp("twins"), dict.fromkeys("abcd", small_file))
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
            "touch_at_vertices": settings.touch_at_vertices.model_copy(
                update={"training": 7, "epochs": 1, "finer_resolution": 20}
            ),
            "retrieval": settings.retrieval.model_copy(update={"epochs": 1, "dimensions": 4}),
            "reconstruction": settings.reconstruction.model_copy(
                update={"steps": 5, "points": 32, "width": 8, "grid": 16, "tests": 1, "surface_points": 200}
            ),
            "grasping": settings.grasping.model_copy(
                update={"grasps": 8, "resolution": 16, "sizes": (16,), "folds": 2}
            ),
            "regrasping": settings.regrasping.model_copy(
                update={
                    "seeds": (0,),
                    "ablation": (("force",),),
                    "rollouts": 2,
                    "rollout_steps": 16,
                    "fixed_episodes": 1,
                    "episodes": 8,
                    "folds": 2,
                }
            ),
        }
    )


@pytest.fixture(scope="session")
def four(small_file, tmp_path_factory):
    """Root of a data set of a mug, a bell, a bar and its twin, which differs in sound alone."""
    bar = load(small_file)
    content = bar.content()
    tensors = content.tensors | {"audio.eigenvalues": 1.2 * content.tensors["audio.eigenvalues"]}
    twin = tmp_path_factory.mktemp("twin") / "twin.safetensors"
    ObjectFile.of_tensors(tensors, bar.description).save(twin)
    paths = {name: EXAMPLES / f"{name}.safetensors" for name in ("bell", "mug")}
    return set_of(tmp_path_factory.mktemp("four"), paths | {"bar": small_file, "twin": twin})


@pytest.fixture(scope="session")
def held():
    """A mug of one convex part, and the force of thrice its weight's."""
    file = example("mug")
    hull = trimesh.convex.convex_hull(file.surface.vertices)
    return {"mug": World(file, [Surface(hull.vertices, hull.faces)])}, {"mug": 3 * least_force_n(file)}


@pytest.fixture
def mugs(tiny, held, tmp_path, monkeypatch):
    """Settings of a data set of one mug by four names, whose parts are known."""
    monkeypatch.setattr(worlds, "_parts", lambda path, digest: [])
    monkeypatch.setattr(worlds, "world_at", lambda path, digest: held[0]["mug"])
    return at_root(tiny, set_of(tmp_path, dict.fromkeys("abcd", EXAMPLES / "mug.safetensors")))


@pytest.fixture
def bars(tiny, small_file, tmp_path):
    """Settings of a data set of one bar with a mass by four names, which is its own convex part."""
    body = example("mug").description["body"] | {"mass_kg": 0.07, "centre_of_mass_m": [0.0, 0.0, 0.0]}
    load(small_file).with_description(body=body).save(tmp_path / "heavy.safetensors")
    return at_root(tiny, set_of(tmp_path, dict.fromkeys("abcd", tmp_path / "heavy.safetensors")))
