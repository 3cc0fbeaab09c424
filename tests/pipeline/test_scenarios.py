"""What each change makes anew: exactly the products that it concerns, over the real declarations of stages.

Derived by hand from what a stage declares that it reads; `executed` has every execution once.
"""

import importlib
import shutil

import numpy as np
import pytest
from PIL import Image
from workshop import Workshop, works
from workshop import made as all_made

from objectfolder.products import provenance
from pipeline.dataset import stage
from pipeline.dataset.stages import (
    COLLISION,
    ENCODED,
    FIDELITY,
    MODES,
    OBJECT_FILES,
    OBJECTS,
    STAGES,
    TOUCHES,
    VIEWS,
)
from pipeline.intake.starter.utensils import fork, spatula
from pipeline.intake.starter.write import write_obj

SLOW_FIXTURES = ("starter",)
IDS = ("cup", "dish", "spoon")  # of steel, wood, wood
SIGHT = ("views", "encode", "fidelity")
SOUND = ("modes", "encode", "fidelity")
TOUCH = ("touches", "encode", "fidelity")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A checkout where all is made."""
    materials = dict(zip(IDS, ("steel", "wood", "wood"), strict=True))
    with all_made(tmp_path_factory.mktemp("scenarios"), "workshop_of_scenarios", **materials) as workshop:
        yield workshop


@pytest.fixture
def workshop(made):
    made.restore()
    return made


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """A checkout without objects."""
    monkeypatch.syspath_prepend(str(tmp_path))
    return Workshop(tmp_path, f"workshop_{abs(hash(str(tmp_path)))}")


@pytest.mark.parametrize(
    ("field", "value", "stages"),
    [
        ("material", "glass", {*SIGHT, *SOUND}),
        ("licence", "CC BY 4.0", {"fidelity"}),
        ("attribution", "B. Maker", {"fidelity"}),
        ("mass_kg", "0.4", {"fidelity"}),
    ],
)
def test_a_cell_of_one_object_changed(workshop, field, value, stages):
    workshop.row("cup")[field] = value
    workshop.save()
    assert workshop.executed() == works(stages, "cup")


@pytest.mark.parametrize(
    ("old", "new", "stages"),
    [
        ("wood,750,", "wood,760,", SOUND),
        (",60,2e-6,0.7,0,", ",61,2e-6,0.7,0,", SOUND),
        (",60,2e-6,0.7,0,", ",60,2e-6,0.6,0,", SIGHT),
        ("isotropic; roughness: ours", "isotropic; roughness: guessed", ("fidelity",)),
    ],
    ids=["density", "damping", "roughness", "citation"],
)
def test_one_row_of_the_materials_edited_concerns_the_objects_of_it(workshop, old, new, stages):
    workshop.edit("data/materials.csv", old, new)
    assert workshop.executed() == works(stages, "dish", "spoon")


def test_row_of_a_material_that_no_object_has(workshop):
    workshop.edit("data/materials.csv", "glass,2600,", "glass,2500,")
    assert workshop.executed() == set()


@pytest.mark.parametrize(
    ("old", "new", "stages"),
    [
        ("    vision:\n      resolution: 128", "    vision:\n      resolution: 64", SIGHT),
        ("accuracy_cents: 5.0", "accuracy_cents: 6.0", SOUND),
        # The encoder reads of touches which sensor and contact they are of, not how many.
        ("      touches: 100\n", "      touches: 90\n", ("touches", "fidelity")),
        ("contact: rigid # as TACTO", "contact: elastic # as TACTO", TOUCH),
        ("sensor: digit # digit", "sensor: gelsight # digit", TOUCH),
        ("threshold_m: null #", "threshold_m: 0.002 #", ("collision", "fidelity")),
        ("steps: 1200", "steps: 1300", ("encode", "fidelity")),
        ("goal_db: -45.0", "goal_db: -41.0", ("encode", "fidelity")),
        ("\nseed: 0", "\nseed: 1", tuple(STAGES)),
        ("allow_failures: true", "allow_failures: false", ()),
        ("accuracy_cents: 2.0", "accuracy_cents: 3.0", ()),  # of a size that is not made
        ("# pixels a side", "# pixels", ()),
    ],
)
def test_parameters_of_one_sense(workshop, old, new, stages):
    workshop.edit("params.yaml", old, new)
    assert workshop.executed() == works(stages, *IDS)


def test_set_back_by_hand_makes_nothing(workshop):
    before = workshop.products()
    workshop.edit("params.yaml", "resolution: 128", "resolution: 64")
    assert workshop.executed() == works(SIGHT, *IDS)
    assert workshop.products() != before
    workshop.edit("params.yaml", "resolution: 64", "resolution: 128")
    assert workshop.executed() == set()
    assert workshop.products() == before


def test_mesh_replaced(workshop):
    workshop.write("cup.obj", "v 0 0 9\n")
    assert workshop.executed() == works(STAGES, "cup")


def test_mesh_file_that_says_the_same_in_other_bytes(workshop):
    workshop.write("cup.obj", "# exported again\nv 0 0 0\n")
    assert workshop.executed() == {"objects cup"}


def test_texture_replaced_leaves_sound_and_touch_alone(workshop):
    workshop.write("cup.png", "another colour")
    assert workshop.executed() == works(("objects", *SIGHT), "cup")


def test_object_removed_and_back(workshop):
    before = workshop.products()
    row = workshop.row("cup")
    workshop.table.remove(row)
    workshop.save()
    assert workshop.executed() == set()
    assert workshop.products() == {path: data for path, data in before.items() if "cup" not in path}
    workshop.table.insert(0, row)
    workshop.save()
    assert workshop.executed() == set()
    assert workshop.products() == before


def test_object_renamed_is_made_anew_for_its_id_is_in_its_seeds(workshop):
    before = workshop.products()
    workshop.row("cup")["id"] = "mug"
    workshop.save()
    assert workshop.executed() == works(STAGES, "mug")
    assert not any("cup" in path for path in workshop.products())
    workshop.row("mug")["id"] = "cup"
    workshop.save()
    assert workshop.executed() == set()
    assert workshop.products() == before


def test_two_objects_exchange_meshes(workshop):
    cup, dish = workshop.row("cup"), workshop.row("dish")
    for name in ("mesh", "texture"):
        cup[name], dish[name] = dish[name], cup[name]
    workshop.save()
    assert workshop.executed() == works(STAGES, "cup", "dish")


def test_rows_in_another_order(workshop):
    workshop.table.reverse()
    workshop.save()
    assert workshop.executed() == set()


@pytest.mark.parametrize(
    "kind",
    [OBJECTS, VIEWS, MODES, TOUCHES, COLLISION, ENCODED, OBJECT_FILES, FIDELITY],
    ids=lambda kind: kind.name,
)
def test_corrupted_product(workshop, kind):
    before = workshop.products()
    shutil.rmtree(workshop.root / ".dvc")  # test_converge shows that the cache makes it good
    path = kind.path(workshop.root, "cup")
    path.write_bytes(path.read_bytes()[:-9])
    # A product made again is the same, so that nothing behind it is.
    assert workshop.executed() == {f"{kind.made_by} cup"}
    assert workshop.products() == before


def test_fail_and_mend(workshop):
    before = workshop.products()
    original = (workshop.root / "cup.obj").read_text()
    workshop.write("cup.obj", "poison")
    assert workshop.executed() == {"objects cup"}
    assert [failure.object for failure in workshop.summaries[0].failures] == ["cup"]
    assert not any("cup" in path for path in workshop.products())
    assert workshop.executed() == {"objects cup"}  # a run of its own tries what failed again
    workshop.write("cup.obj", "v 0 0 7\n")
    assert workshop.executed() == works(STAGES, "cup")
    workshop.write("cup.obj", original)
    assert workshop.executed() == set()
    assert workshop.products() == before


@pytest.mark.parametrize(
    ("module", "old", "new", "stages"),
    [
        ("views", "return product(", "return  product( # why\n        ", ()),
        ("optics", '"""Light."""', '"""Light in glass."""\n# Snell.', ()),
        ("stranger", "VALUE = 1", "VALUE = 2", ()),
        ("optics", "INDEX = 3", "INDEX = 4", SIGHT),
        ("elasticity", "int(", "round(", SOUND),
        ("units", "PASCAL = 1.0", "PASCAL = 2.0", SOUND),
        ("touches", "request.seed,", "request.seed + 1,", ("touches", "fidelity")),
        ("fidelity", '"name": ', '"title": ', ("fidelity",)),
        ("counting", "value % 97", "value % 89", tuple(STAGES)),
    ],
    ids=[
        "comment", "docstring of a dependency", "module nobody imports", "dependency imported in a function",
        "dependency", "dependency of a dependency", "one body", "last stage", "what all share",
    ],
)  # fmt: skip
def test_code_changed(workshop, module, old, new, stages):
    workshop.edit_code(module, old, new)
    assert workshop.executed() == works(stages, *IDS)


@pytest.fixture
def install(tmp_path_factory, monkeypatch):
    """Put distributions of given versions before those installed."""
    folder = tmp_path_factory.mktemp("site")
    monkeypatch.syspath_prepend(str(folder))
    caches = provenance._version, stage._versions

    def put(name, version):
        for old in folder.glob(f"{name}-*.dist-info"):
            shutil.rmtree(old)
        metadata = folder / f"{name}-{version}.dist-info" / "METADATA"
        metadata.parent.mkdir()
        metadata.write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        importlib.invalidate_caches()
        for cache in caches:
            cache.cache_clear()  # a process of its own would see it at once

    yield put
    for cache in caches:
        cache.cache_clear()


@pytest.mark.parametrize(
    ("package", "stages"),
    [
        ("pytetwild", SOUND),
        ("bpy", SIGHT),
        ("numba", ("modes", "touches", "encode", "fidelity")),
        ("coacd", ("collision", "fidelity")),
        ("torch", ("encode", "fidelity")),
        ("DracoPy", ("objects",)),  # what it makes is the same, so that nothing behind it is made
        ("dask", ()),
    ],
)
def test_version_of_a_package_changed(empty, install, package, stages):
    install(package, "1.0")
    empty.add("cup")
    assert empty.executed() == works(STAGES, "cup")
    install(package, "1.1")
    assert empty.executed() == works(stages, "cup")
    install(package, "1.0")
    assert empty.executed() == set()


class Starter:
    """Two objects of the starter set, cleaned and measured by the real task."""

    def __init__(self, workshop):
        self.workshop = workshop
        self.fork = workshop.root / "fork"
        workshop.stages = (STAGES["objects"], *workshop.stages[1:])
        for name, make in (("fork", fork), ("spatula", spatula)):
            folder = workshop.root / name
            folder.mkdir()
            write_obj(folder / "model.obj", make())
            row = {"id": name, "mesh": f"../{name}/model.obj", "texture": f"../{name}/texture.png"}
            workshop.table.append({**row, "material": "steel"})
        workshop.save()
        assert self.made() == works(STAGES, "fork", "spatula")

    def made(self):
        return {
            f"{summary.stage} {object_id}"
            for summary in self.workshop.converge()
            for object_id in summary.computed
        }


@pytest.fixture(scope="module")
def starter(tmp_path_factory):
    """Each test changes it from where all is made to where all is made."""
    root = tmp_path_factory.mktemp("starter") / "checkout"
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(root))
        yield Starter(Workshop(root, "workshop_of_starter"))


def test_real_texture_replaced(starter):
    path = starter.fork / "texture.png"
    pixels = np.asarray(Image.open(path).convert("RGB"))
    Image.fromarray(255 - pixels).save(path)
    assert starter.made() == works(("objects", *SIGHT), "fork")
    Image.fromarray(255 - pixels).save(path, compress_level=1)  # other bytes of the same picture
    assert starter.made() == {"objects fork"}


def test_real_mesh_with_a_comment(starter):
    path = starter.fork / "model.obj"
    path.write_text("# exported again\n" + path.read_text())
    assert starter.made() == {"objects fork"}


def test_real_texture_under_another_name(starter):
    shutil.copy(starter.fork / "texture.png", starter.fork / "colours.png")
    starter.workshop.row("fork")["texture"] = "../fork/colours.png"
    starter.workshop.save()
    assert starter.made() == {"objects fork"}
    starter.workshop.row("fork")["texture"] = "../fork/texture.png"
    starter.workshop.save()
    assert starter.made() == set()
