"""Folds of unseen objects: near twins together, test objects of the data set first."""

from itertools import chain
from types import SimpleNamespace

from learning import folds
from learning.folds import folds_of, near_twins
from learning.runs import Objects
from objectfolder.products import object_split
from tests.learning.conftest import at_root


def test_near_twins_are_unseen_together(four, tiny):
    settings = at_root(tiny, four)
    objects = Objects(settings)
    groups = [[objects.ids[position] for position in group] for group in near_twins(objects)]
    assert sorted(groups) == [["bar", "twin"], ["bell"], ["mug"]]
    parts = folds_of(objects, settings)
    assert sorted(chain.from_iterable(parts)) == [0, 1, 2, 3]
    assert {"bar", "twin"} in [{objects.ids[position] for position in part} for part in parts]


def test_objects_that_are_all_alike_have_no_folds(tiny):
    assert folds_of(Objects(tiny), tiny) == []


def test_the_first_fold_holds_the_test_objects_of_the_data_set(tiny, monkeypatch):
    ids = [f"cup{number}" for number in range(97)]
    files = {name: SimpleNamespace(material="ceramic") for name in ids}
    pairs = [[number, number + 1] for number in range(0, 20, 2)]
    groups = [list(range(20, 32)), *pairs, *([number] for number in range(32, 97))]
    monkeypatch.setattr(folds, "near_twins", lambda objects: groups)

    class Named(SimpleNamespace):
        def __len__(self):
            return len(self.ids)

    parts = folds_of(Named(ids=ids, files=files), tiny)
    assert sorted(chain.from_iterable(parts)) == list(range(97))
    assert all(any(set(group) <= set(part) for part in parts) for group in groups)
    assert len(parts) == tiny.folds
    # A fold ends with the group that fills it.
    assert all(abs(len(part) - 97 / tiny.folds) < 12 for part in parts)
    tested = {group[0] for group in groups if object_split(ids[group[0]], "ceramic") == "test"}
    assert tested <= set(parts[0])
