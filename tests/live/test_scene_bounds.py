"""Scenes that ask for much are refused before MuJoCo reads them."""

from itertools import pairwise

import pytest

from objectfolder.errors import InputError
from pipeline.publish.scenes.scene_bounds import check_scene

TWICE = '<replicate count="300"><replicate count="300">'
BODY = '<body name="0_mug"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'


def scene(folder, text, name="scene.xml"):
    path = folder / name
    path.write_text(f"<mujoco>{text}</mujoco>")
    return path


def attached(model: str, times: int) -> str:
    """Return a model with the assets repeated."""
    bodies = f'<attach model="{model}" body="b"/>' * times
    return f'<asset><model name="{model}" file="{model}.xml"/></asset><worldbody>{bodies}</worldbody>'


@pytest.mark.parametrize(
    ("text", "finding"),
    [
        (f'<worldbody>{TWICE}{BODY}</replicate></replicate></worldbody>', "20000 elements at <replicate>"),
        ('<worldbody><flexcomp count="100 100 100"/></worldbody>', "more than 20000 elements at <flexcomp>"),
        ('<asset><hfield nrow="100000" ncol="100000" size="1 1 1 1"/></asset>', "<hfield> has 10000000000"),
        ('<asset><texture builtin="flat" width="1e5" height="1e5"/></asset>', "<texture> has 10000000000"),
        ('<asset><texture file="/dev/zero"/></asset>', "names /dev/zero, which is no file"),
        ('<worldbody>' + '<body>' * 100 + '</body>' * 100 + '</worldbody>', "nested more than 60 deep"),
        ('<extension><plugin plugin="evil.so"/></extension>', "names a plugin"),
        ('<worldbody>', "no scene of MuJoCo"),
    ],
)  # fmt: skip
def test_what_asks_for_much_is_refused(tmp_path, text, finding):
    with pytest.raises(InputError) as raised:
        check_scene(scene(tmp_path, text))
    assert finding in str(raised.value)
    assert "\n" not in str(raised.value)


def test_documents_with_entities_are_refused(tmp_path):
    (tmp_path / "scene.xml").write_text('<!DOCTYPE x [<!ENTITY a "b">]><mujoco/>')
    with pytest.raises(InputError, match="declares a type of document"):
        check_scene(tmp_path / "scene.xml")


def test_models_that_bring_models_are_counted_together(tmp_path):
    names = ["scene", *"abcde"]
    for name, model in pairwise(names):
        scene(tmp_path, attached(model, 10), f"{name}.xml")
    scene(tmp_path, f"<worldbody>{BODY}</worldbody>", "e.xml")
    check_scene(tmp_path / "c.xml")
    with pytest.raises(InputError, match="more than 20000 elements"):
        check_scene(tmp_path / "scene.xml")


def test_a_file_larger_than_any_is_refused(tmp_path):
    with (tmp_path / "m.stl").open("wb") as file:
        file.truncate(1 << 30)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "m.stl").rename(tmp_path / "meshes/m.stl")
    with pytest.raises(InputError, match=r"m\.stl of 1073741824 bytes"):
        check_scene(scene(tmp_path, '<compiler meshdir="meshes"/><asset><mesh file="m.stl"/></asset>'))
