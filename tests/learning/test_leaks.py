"""Nothing of a test reaches a training: splits by their contents, fits that another test leaves alone."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import torch

from learning import encoders, reconstruction, runs, stand_in
from learning.encoders import SPLITS, Encoded, Encoder, object_draws
from learning.folds import folds_of
from learning.grasping import policy_comparison, stability, touch_policy, worlds
from learning.networks import Labelled
from learning.occupancy import Shapes
from learning.reconstruction import Trial
from learning.retrieval import similarities
from learning.runs import Objects
from learning.samples import SENSES, regions_of, stored
from learning.settings import Retrieval
from learning.vertices import AT_VERTICES
from objectfolder.dataset import ObjectFolderDataset
from objectfolder.errors import InputError
from objectfolder.products.provenance import seed_from
from tests.learning.conftest import EXAMPLES, at_root, set_of


@pytest.fixture(scope="module")
def objects(four, tiny):
    return Objects(at_root(tiny, four))


def rows_of(array):
    """The rows of an array by their bytes."""
    return {row.tobytes() for row in np.ascontiguousarray(array)}


def splits_of(objects, settings, sense, protocol):
    """The samples of each split, an entry an object."""
    draws = list(object_draws(objects, settings, sense, protocol, 0, SPLITS))
    return [[samples[split] for samples in draws] for split in SPLITS]


@pytest.mark.parametrize("protocol", AT_VERTICES)
def test_no_vertex_of_a_split_is_in_another(tiny, protocol):
    if protocol == "vertex region":  # which wants vertices in every region
        at_vertices = tiny.touch_at_vertices.model_copy(update={"training": 150})
        tiny = tiny.model_copy(update={"touch_at_vertices": at_vertices})
    objects = Objects(tiny)
    splits = splits_of(objects, tiny, "touch", protocol)
    counts = tiny.touch_at_vertices.training, tiny.data.validation, tiny.data.test
    for samples, count in zip(splits, counts, strict=True):
        for file, touches in zip(objects.files.values(), samples, strict=True):
            assert len(touches.places) == len(rows_of(touches.places))
            assert len(touches.places) == count if protocol == "vertex" else 0 < len(touches.places) <= count
            assert rows_of(touches.places) <= rows_of(file.surface.vertices)
            assert set(touches.queries.ravel()) == {tiny.touch_at_vertices.depth_m}
    for first, second in combinations(splits, 2):
        for first_touches, second_touches in zip(first, second, strict=True):
            assert not rows_of(first_touches.places) & rows_of(second_touches.places)
    if protocol == "vertex region":
        for name, file, *samples in zip(objects.ids, objects.files.values(), *splits, strict=True):
            _, tested = regions_of(file, "touch", tiny.data.regions, seed_from(0, "regions", name))
            assert [tested(part.places).mean() for part in samples] == [0, 0, 1]


def test_an_object_without_vertices_to_train_on_is_an_error(tiny):
    many = tiny.model_copy(update={"data": tiny.data.model_copy(update={"test": 10_000})})
    with pytest.raises(InputError, match=r"a: \d+ vertices can be pressed, 10005 are needed"):
        list(object_draws(Objects(tiny), many, "touch", "vertex", 0, ("training",)))


@pytest.mark.parametrize("sense", SENSES)
def test_no_sample_of_a_split_is_in_another(objects, tiny, sense):
    for protocol in ("sample", "region"):
        splits = splits_of(objects, tiny, sense, protocol)
        for first, second in combinations(splits, 2):
            for first_samples, second_samples in zip(first, second, strict=True):
                assert not rows_of(first_samples.places) & rows_of(second_samples.places)
                assert not rows_of(first_samples.inputs) & rows_of(second_samples.inputs)


def _with_truth(small_file, tiny, root, kind):
    """Settings of a data set of one bar by four names, with its truth of one kind."""
    for folder, suffix in ((kind, ".zarr.zip"), ("object_files", ".safetensors")):
        (root / "data" / folder).mkdir(parents=True)
        source = small_file if folder == "object_files" else small_file.with_name(f"{kind}.zarr.zip")
        for name in "abcd":
            (root / "data" / folder / f"{name}{suffix}").symlink_to(source)
    return at_root(tiny, root)


def test_the_stand_in_is_tested_on_held_out_queries(small_file, tiny, tmp_path):
    settings = _with_truth(small_file, tiny, tmp_path, "views")
    for splits in stand_in.drawn(Objects(settings), settings, "vision", 0, [16])[0].values():
        learnt = rows_of(splits["training"].inputs) | rows_of(splits["validation"].inputs)
        assert learnt
        assert not rows_of(splits["test"].inputs) & learnt


def test_the_stand_in_hears_no_strike_that_its_sound_was_fitted_to(small_file, tiny, tmp_path):
    settings = _with_truth(small_file, tiny, tmp_path, "modes")
    objects = Objects(settings)
    (samples,) = stand_in.drawn(objects, settings, "audio", 0, [settings.data.resolution.audio])
    data = settings.data
    sizes = {"training": data.training.audio, "validation": data.validation, "test": data.test}
    for splits in samples.values():
        assert {split: len(part.labels) for split, part in splits.items()} == {
            split: 4 * size for split, size in sizes.items()
        }
        for first, second in combinations(splits.values(), 2):
            assert not rows_of(first.inputs) & rows_of(second.inputs)
    fitted = ObjectFolderDataset(tmp_path, "audio", "training", "truth", objects=["a"])
    everything = rows_of(stored(fitted, len(fitted), 0, [data.resolution.audio])[0])
    for part in samples["truth"].values():
        assert not rows_of(part.inputs) & everything


def labelled(count, seed, classes=4):
    random = torch.Generator().manual_seed(seed)
    labels = torch.arange(count) % classes
    return Labelled(torch.rand(count, 3, 16, 16, generator=random) + labels[:, None, None, None], labels)


@pytest.mark.slow
@pytest.mark.parametrize(("protocol", "pretrained"), [("sample", False), ("unseen", False), ("sample", True)])
def test_an_encoder_does_not_depend_on_its_test(objects, tiny, tmp_path, monkeypatch, protocol, pretrained):
    monkeypatch.setattr(encoders, "LOGS", tmp_path)
    unseen = folds_of(objects, tiny)[0] if protocol == "unseen" else []
    fixed = {"training": labelled(16, 0), "validation": labelled(8, 1)}
    outputs = []
    for seed in (2, 3):
        samples = {**fixed, "test": labelled(8, seed)}
        if unseen:  # nor on any sample of an unseen object
            out = torch.isin(fixed["training"].labels, torch.tensor(unseen))
            changed = torch.where(out[:, None, None, None], seed, fixed["training"].inputs)
            samples["training"] = Labelled(changed, fixed["training"].labels)
        monkeypatch.setattr(encoders, "drawn", lambda *arguments, samples=samples: (samples, 0.0))
        outputs.append(encoders._train(objects, tiny, "vision", protocol, 0, unseen, pretrained))
    for name in ("training/logs", "validation/logs"):
        np.testing.assert_array_equal(outputs[0][name], outputs[1][name])
    assert not np.array_equal(outputs[0]["test/logs"], outputs[1]["test/logs"])
    assert set(outputs[0]["test/labels"]) == (set(unseen) or set(range(4)))
    assert not set(outputs[0]["training/labels"]) & set(unseen)


def features(seed, tests):
    """Features of four objects, whose test split alone depends on `tests`."""
    splits = {}
    for number, split in enumerate(("training", "validation", "test")):
        random = np.random.default_rng([seed, number, tests if split == "test" else 0])
        labels = np.arange(16) % 4
        values = (random.normal(size=(16, 8)) + labels[:, None]).astype(np.float32)
        logs = torch.log_softmax(torch.from_numpy(values[:, :4]), dim=1).numpy()
        splits[split] = Encoded(values, logs, labels, values[:, ::2])
    return Encoder(splits, 0.1)


@pytest.mark.slow
def test_common_spaces_do_not_depend_on_the_labels_of_their_test():
    parameters = Retrieval(dimensions=4, epochs=2, margin=0.2, temperature=0.1, end_to_end_folds=0)
    pair = features(0, 0), features(1, 0)
    swapped = [
        Encoder(
            encoder.splits
            | {"test": replace(encoder.splits["test"], labels=encoder.splits["test"].labels[::-1])},
            0.1,
        )
        for encoder in pair
    ]
    plain, similarities_swapped = (
        similarities(pair, 4, parameters, 0),
        similarities(tuple(swapped), 4, parameters, 0),
    )
    for method, similarity in plain.items():
        np.testing.assert_array_equal(similarity, similarities_swapped[method], err_msg=method)


def test_an_occupancy_network_is_fitted_to_training_samples_of_known_objects(tiny, monkeypatch):
    fitted = []

    class Fitted(Exception):
        pass

    def fit(conditions, labels, shapes, object_indices, parameters, seed):
        fitted.append((conditions, object_indices))
        raise Fitted

    monkeypatch.setattr(reconstruction, "fit", fit)
    measures = type("", (), {"shapes": Shapes({}, torch.zeros(0, 3), torch.zeros(0, 0))})()
    for tests in (0, 1):
        monkeypatch.setattr(reconstruction, "encoded", lambda *arguments, tests=tests: features(0, tests))
        with pytest.raises(Fitted):
            Trial(None, tiny, measures, ("vision",), (0, 2), (1, 3), (1, 3), 0)._predict()
    assert torch.equal(fitted[0][0], fitted[1][0])
    assert fitted[0][1] == (0, 2)


@pytest.mark.slow
def test_no_grasp_of_a_test_is_trained_on(objects, tiny):
    grasps = {"held": np.arange(32) % 3 == 0, "object": np.arange(32) // 8}
    units = [*stability._by_size(grasps, tiny), *stability._by_object(objects, grasps, tiny)]
    assert len(units) == tiny.grasping.folds + 4
    for case, training, test in units:
        assert not set(training) & set(test)
        if isinstance(case, str):
            assert set(grasps["object"][test]) == {objects.ids.index(case)}
            assert not set(grasps["object"][training]) & set(grasps["object"][test])


@pytest.mark.slow
def test_no_policy_and_no_fixed_move_depends_on_an_object_that_is_left_out(mugs, held, tmp_path, monkeypatch):
    stems, results = set(), []

    def world_at(path, digest):
        stems.add(path.stem)
        return held[0]["mug"]

    monkeypatch.setattr(worlds, "world_at", world_at)
    for object_name in ("mug", "bell"):
        monkeypatch.setattr(runs, "RUNS", tmp_path / object_name)
        paths = dict.fromkeys("abc", EXAMPLES / "mug.safetensors") | {
            "d": EXAMPLES / f"{object_name}.safetensors"
        }
        settings = at_root(mugs, set_of(tmp_path / f"set of {object_name}", paths))
        grasps = touch_policy.Grasps(Objects(settings), settings, ["d"])
        policy = grasps.learnt(settings.regrasping.seeds[0]).policy
        weights = {name: value.numpy().tobytes() for name, value in policy.state_dict().items()}
        tried = grasps.tried((0.25, 0.0, 0.0))
        files = sorted(path.name for path in (tmp_path / object_name).iterdir())
        results.append((weights, {name: values.tobytes() for name, values in tried.items()}, files))
    assert results[0] == results[1]
    assert stems == set("abc")


@pytest.mark.slow
def test_each_episode_is_done_once_by_a_policy_that_does_not_know_its_object(mugs, held, monkeypatch):
    objects, folds = Objects(mugs), [["a", "d"], ["b", "c"]]
    for learners in policy_comparison.unseen_learners(objects, mugs, folds).values():
        done = []
        for learner, fold in zip(learners, folds, strict=True):
            assert (
                set(learner.training.ids) == set(learner.training.worlds.digests) == set("abcd") - set(fold)
            )
            environment = learner.test.environment(1.0, 0.01)
            object_ids = {environment.reset(seed=seed)[1]["object"] for seed in learner.test_seeds}
            assert object_ids <= set(fold)
            done += learner.test_seeds
        assert sorted(done) == list(learner.test.test_seeds)
