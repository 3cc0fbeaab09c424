"""Truth and Object Files as PyTorch samples: the same queries, the same keys, in any kind of worker."""

import pickle
import shutil
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import torch
import zarr
from torch.utils.data import DataLoader
from zarr.codecs import BloscCodec, BytesCodec, GzipCodec

import objectfolder
from objectfolder.audio.synthesis import mode_bank
from objectfolder.dataset import ObjectBatches, ObjectFolderDataset, reading
from objectfolder.errors import FormatError, InputError
from objectfolder.fidelity.images import psnr_db
from objectfolder.fidelity.sound import held_out_gains, struck
from objectfolder.products.splits import object_split
from objectfolder.products.store import Array, Product, read_product, write_product
from objectfolder.vision.compositing import on_white

SHAPES = {
    "vision": {
        "image": ((3, 24, 24), torch.float32),
        "depth_m": ((24, 24), torch.float32),
        "mask": ((24, 24), torch.bool),
        "camera_to_object": ((4, 4), torch.float32),
        "light_position_m": ((3,), torch.float32),
    },
    "audio": {
        "sound": ((4410,), torch.float32),
        "point_m": ((3,), torch.float32),
        "impulse_n_s": ((3,), torch.float32),
    },
    "touch": {
        "image": ((3, 160, 120), torch.float32),
        "depth_m": ((160, 120), torch.float32),
        "mask": ((160, 120), torch.bool),
        "sensor_to_object": ((4, 4), torch.float32),
        "reachable": ((), torch.bool),
        "point_m": ((3,), torch.float32),
        "press_depth_m": ((), torch.float32),
        "tilt_deg": ((), torch.float32),
        "azimuth_deg": ((), torch.float32),
    },
}
COUNTS = {"vision": (6, 2), "audio": (120, 20), "touch": (3, 6)}
KINDS = {"vision": "views", "audio": "modes", "touch": "touches"}


def of(root, sense, split="held_out", source="truth", **settings):
    return ObjectFolderDataset(root, sense, split, source, duration_s=0.1, passes=True, **settings)


def equal(first, second):
    return first.keys() == second.keys() and all(
        torch.equal(value, second[key]) if torch.is_tensor(value) else value == second[key]
        for key, value in first.items()
    )


@pytest.mark.parametrize(
    "other",
    [
        {"serializer": BytesCodec(endian="big"), "compressors": [BloscCodec()]},
        {"compressors": [GzipCodec()]},
        {"compressors": [BloscCodec()], "chunks": (2, 3)},
    ],
)
def test_another_layout_is_refused_and_not_misread(tmp_path, other):
    path = tmp_path / "other.zarr.zip"
    with zarr.storage.ZipStore(path, mode="w") as store:
        group = zarr.create_group(store)
        group.create_array("values", data=np.arange(12.0).reshape(4, 3), **{"chunks": (4, 3), **other})
    with pytest.raises(FormatError, match="no readable array values"):
        reading.ProductReader(path).whole("values")


@pytest.mark.parametrize("source", ["truth", "object_file"])
@pytest.mark.parametrize("sense", SHAPES)
def test_samples_are_as_documented(small_set, sense, source):
    for split, count in zip(("training", "held_out"), COUNTS[sense], strict=True):
        samples = of(small_set, sense, split, source)
        assert len(samples) == 2 * count
        sample = samples[count]
        assert sample["object_id"] == "rod"
        held_out = read_product(small_set / f"data/{KINDS[sense]}/rod.zarr.zip", ("held_out",))["held_out"]
        assert bool(held_out[sample["query"]]) == (split == "held_out")
        tensors = {key: (tuple(v.shape), v.dtype) for key, v in sample.items() if torch.is_tensor(v)}
        assert tensors == SHAPES[sense]


@pytest.mark.parametrize("sense", SHAPES)
def test_object_files_answer_the_queries_of_the_truth(small_set, sense):
    truth, answer = of(small_set, sense), of(small_set, sense, source="object_file")
    index = len(truth) - 1
    true_sample, file_sample = truth[index], answer[index]
    for key in ("camera_to_object", "light_position_m", "point_m", "impulse_n_s", "press_depth_m", "query"):
        if key in true_sample:
            assert np.array_equal(true_sample[key], file_sample[key])
    if sense == "audio":
        error = (true_sample["sound"] - file_sample["sound"]).norm() / true_sample["sound"].norm()
        assert error < 0.3  # fitted to 120 points; the sound of another point is 1 or more off
        return
    pictures = [
        (255 * entry["image"].numpy()).round().astype(np.uint8) for entry in (true_sample, file_sample)
    ]
    assert psnr_db(*pictures) > 25
    assert (true_sample["mask"] == file_sample["mask"]).float().mean() > 0.99
    both = true_sample["mask"] & file_sample["mask"]
    assert both.any()
    assert torch.allclose(true_sample["depth_m"][both], file_sample["depth_m"][both], atol=3e-4)


def test_truth_is_that_of_the_products(small_set):
    views = read_product(small_set / "data/views/bar.zarr.zip")
    rows = np.flatnonzero(views["held_out"])
    sample = of(small_set, "vision")[1]
    image = np.round(sample["image"].numpy() * 255).astype(np.uint8).transpose(1, 2, 0)
    assert np.array_equal(image, on_white(views["rgba"][rows[1]].astype(np.float32)))
    scale = views.attributes["frame"]["scale"]
    assert np.allclose(sample["depth_m"], views["depth"][rows[1]] * scale)
    distance = np.linalg.norm(sample["camera_to_object"].numpy()[:3, 3] - views.attributes["frame"]["centre"])
    assert distance == pytest.approx(2.5 * scale, rel=1e-5)  # metres of the object frame
    touches = read_product(small_set / "data/touches/bar.zarr.zip")
    sample = of(small_set, "touch", "training")[2]
    row = np.flatnonzero(~touches["held_out"])[2]
    assert np.array_equal(np.round(sample["image"].numpy() * 255).transpose(1, 2, 0), touches["rgb"][row])


def test_sounds_are_the_velocity_where_a_held_out_point_is_struck(small_set):
    file = objectfolder.load(small_set / "data/object_files/bar.safetensors")
    modes = read_product(small_set / "data/modes/bar.zarr.zip")
    points, impulses = struck(modes)
    normals = modes["normals"][modes["held_out"]][: len(points)]
    shapes = held_out_gains(modes)[: len(points)]
    start = np.einsum("nk,nkm->nm", impulses, shapes) * np.einsum("nk,nkm->nm", normals, shapes)
    truth = mode_bank(
        modes["eigenvalues"], modes["dampings_per_s"], start, duration_s=1.0, sample_rate_hz=44100.0
    )
    for source, sounds in (("truth", truth), ("object_file", file.strike(points, impulses, 1.0))):
        samples = ObjectFolderDataset(small_set, "audio", "held_out", source)
        for index in (0, 1, 17):
            assert np.allclose(
                samples[index]["sound"], sounds[index], rtol=1e-5, atol=1e-6 * np.abs(sounds).max()
            )


@pytest.mark.parametrize(
    ("context", "source"),
    [
        ("fork", "truth"),
        pytest.param("spawn", "truth", marks=pytest.mark.slow),
        ("fork", "object_file"),
    ],
)
def test_workers_give_the_same_samples(small_set, context, source):
    samples = of(small_set, "touch", source=source)
    alone = [
        samples[index] for index in range(len(samples))
    ]  # archives and kernels are in use before the fork
    workers = 1 if context == "spawn" else 2  # one that starts anew imports torch
    loader = DataLoader(
        samples, batch_size=4, num_workers=workers, multiprocessing_context=context, timeout=300
    )
    batches = list(loader)
    assert torch.equal(
        torch.cat([batch["image"] for batch in batches]), torch.stack([s["image"] for s in alone])
    )
    assert [name for batch in batches for name in batch["object_id"]] == [s["object_id"] for s in alone]
    assert batches[0]["query"].tolist() == [s["query"] for s in alone[:4]]


@pytest.mark.parametrize("sense", SHAPES)
def test_a_copy_by_pickle_gives_the_same_samples(small_set, sense):
    samples = of(small_set, sense)
    first = samples[5 % len(samples)]
    copied = pickle.dumps(samples)
    assert len(copied) < 10_000
    assert equal(pickle.loads(copied)[5 % len(samples)], first)
    assert equal(samples[5 % len(samples) - len(samples)], first)


def test_an_image_is_read_alone(small_set, monkeypatch):
    read = []
    original = reading.ProductReader._read

    def noted(self, name, selection):
        read.append((name, selection))
        return original(self, name, selection)

    monkeypatch.setattr(reading.ProductReader, "_read", noted)
    samples = of(small_set, "touch", "held_out")
    assert {name for name, _ in read} == {"held_out", "reachable"}
    read.clear()
    queries = [sample["query"] for sample in samples.__getitems__([3, 1])]
    images = {name: selection.tolist() for name, selection in read if name in ("rgb", "depth", "mask")}
    assert images == dict.fromkeys(("rgb", "depth", "mask"), queries)


@pytest.mark.parametrize("kind", KINDS.values())
def test_arrays_are_those_that_are_stored(small_set, kind):
    path = small_set / f"data/{kind}/bar.zarr.zip"
    stored, reader = read_product(path), reading.ProductReader(path)
    assert reader.attributes == stored.attributes
    for name, array in stored.arrays.items():
        assert reader.shape(name) == array.data.shape
        np.testing.assert_array_equal(reader.whole(name), array.data)
        rows = np.arange(len(array.data))[::-2]
        np.testing.assert_array_equal(reading.ProductReader(path).rows(name, rows), array.data[rows])


def test_chunks_that_are_not_stored_are_filled(tmp_path):
    masks = np.zeros((3, 80, 80), dtype=bool)
    masks[1, 2:] = True
    empty = Array(np.zeros((4, 0)), ("point", "mode"), "1", "no mode", False)
    path = tmp_path / "masks.zarr.zip"
    write_product(path, Product({"mask": Array(masks, ("view", "y", "x"), "1", "mask"), "none": empty}))
    assert "mask/c/0/0/0" not in zipfile.ZipFile(path).namelist()
    reader = reading.ProductReader(path)
    assert np.array_equal(reader.rows("mask", np.array([2, 1, 0])), masks[::-1])
    assert reader.whole("none").shape == (4, 0)


@pytest.mark.parametrize("source", ["truth", "object_file"])
@pytest.mark.parametrize("sense", SHAPES)
def test_samples_of_a_batch_are_those_asked_for_alone(small_set, sense, source):
    samples = of(small_set, sense, source=source)
    indices = [len(samples) - 1, 0, 1, -1, 0]
    batch = samples.__getitems__(indices)
    assert [entry["object_id"] for entry in batch] == ["rod", "bar", "bar", "rod", "bar"]
    assert all(equal(entry, samples[index]) for entry, index in zip(batch, indices, strict=True))


def changed(small_set, root, kind, **arrays):
    """Write a data set of one product of the bar, with other values of some arrays; return its root."""
    product = read_product(small_set / f"data/{kind}/bar.zarr.zip")
    replacements = {
        name: replace(product.arrays[name], data=data(product[name])) for name, data in arrays.items()
    }
    write_product(
        root / f"data/{kind}/changed.zarr.zip",
        Product({**product.arrays, **replacements}, product.attributes),
    )
    return root


def test_silence_is_left_out_unless_asked_for(small_set, small_file, tmp_path):
    silent = {"frequencies_hz", "eigenvalues", "dampings_per_s", "radiation_weights", "mode_shapes"}
    root = changed(small_set, tmp_path, "modes", **dict.fromkeys(silent, lambda values: values[..., :0]))
    with pytest.raises(InputError, match=r"changed: no mode up to 20021 Hz.*all_queries=True"):
        of(root, "audio")
    everything = of(root, "audio", all_queries=True)
    assert len(everything) == COUNTS["audio"][1]
    assert not everything[0]["sound"].any()
    shutil.copy(small_set / "data/modes/bar.zarr.zip", root / "data/modes/bar.zarr.zip")
    assert of(root, "audio").object_ids == ["bar"]
    with pytest.raises(InputError, match="no mode up to 45 Hz"):  # all are above what this rate can hold
        ObjectFolderDataset(small_file, "audio", source="object_file", sample_rate_hz=100)


def test_touches_out_of_reach_are_left_out_unless_asked_for(small_set, tmp_path):
    def alternating(values):
        return np.arange(len(values)) % 2 == 0

    root = changed(small_set, tmp_path, "touches", reachable=alternating)
    reached, everything = of(root, "touch"), of(root, "touch", all_queries=True)
    queries = [sample["query"] for sample in everything]
    assert [sample["query"] for sample in reached] == [query for query in queries if query % 2 == 0]
    assert len(everything) == COUNTS["touch"][1]


def test_batches_of_few_objects_have_every_sample_once_an_epoch(small_file, tmp_path):
    files = [shutil.copy(small_file, tmp_path / f"{name}.safetensors") for name in "abcde"]
    samples = ObjectFolderDataset(files, "touch", source="object_file", queries=6)
    batches = ObjectBatches(samples, 4, together=2, seed=3)
    first, second = list(batches), list(batches)
    assert first != second
    assert first == list(ObjectBatches(samples, 4, together=2, seed=3))
    for epoch in (first, second):
        assert sorted(index for batch in epoch for index in batch) == list(range(30))
        assert [len(batch) for batch in epoch] == [4] * 7 + [2]
        order = [samples.place(index)[0] for batch in epoch for index in batch]
        assert [len(set(order[start : start + 12])) for start in (0, 12, 24)] == [2, 2, 1]
    loader = DataLoader(samples, batch_sampler=ObjectBatches(samples, 4, together=2, seed=3))
    assert next(iter(loader))["query"].tolist() == [samples.place(index)[1] for index in first[0]]
    with pytest.raises(InputError, match="together: 0"):
        ObjectBatches(samples, 4, together=0)


def test_no_more_is_kept_open_than_asked_for(small_set):
    samples = of(small_set, "audio", source="object_file", open_objects=1)
    first = samples[0]
    assert samples[len(samples) - 1]["object_id"] == "rod"
    assert len(samples._object_files._values) == len(samples._products._values) == 1
    assert equal(samples[0], first)


@pytest.mark.parametrize("sense", SHAPES)
def test_files_alone_have_drawn_queries(small_file, sense):
    settings = {"source": "object_file", "queries": 3, "seed": 7, "duration_s": 0.1, "resolution": 16}
    samples = ObjectFolderDataset([small_file], sense, "training", **settings)
    again = ObjectFolderDataset(str(small_file), sense, "training", **settings)
    held_out_samples = ObjectFolderDataset([small_file], sense, "held_out", **settings)
    assert len(samples) == 3
    key = "camera_to_object" if sense == "vision" else "point_m"
    assert all(equal(samples[index], again[index]) for index in range(3))
    assert not torch.equal(samples[0][key], held_out_samples[0][key])
    assert not torch.equal(samples[0][key], samples[1][key])


@pytest.mark.parametrize("text", [b"{", b"[1]", b'{"zarr_format":3,"node_type":"array"}'])
def test_damaged_metadata_of_an_array_is_said(small_set, tmp_path, text):
    path = tmp_path / "data/touches/bar.zarr.zip"
    path.parent.mkdir(parents=True)
    with (
        zipfile.ZipFile(small_set / "data/touches/bar.zarr.zip") as whole,
        zipfile.ZipFile(path, "w") as damaged,
    ):
        for name in whole.namelist():
            damaged.writestr(name, text if name == "held_out/zarr.json" else whole.read(name))
    with pytest.raises(FormatError, match=r"bar\.zarr\.zip: no readable array held_out"):
        ObjectFolderDataset(tmp_path, "touch")


def test_a_split_of_objects_without_their_records_says_where_those_are(small_set, tmp_path):
    shutil.copytree(small_set / "data/touches", tmp_path / "data/touches")
    with pytest.raises(InputError, match=r"records\.json: .*Copy it from the data set's repository"):
        of(tmp_path, "touch", object_split="train")


def test_objects_are_chosen_by_name_and_by_split(small_set):
    assert of(small_set, "touch", objects=["rod"]).object_ids == ["rod"]
    for part in ("train", "validation", "test"):
        object_ids = [name for name in ("bar", "rod") if object_split(name, "glass") == part]
        assert of(small_set, "touch", object_split=part).object_ids == object_ids
    with pytest.raises(InputError, match=r"no object 'rd'\. There are rod"):
        of(small_set, "touch", objects=["rd"])


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (("smell",), "there is no 'smell'"),
        (("touch", "test"), "there is no 'test'"),
        (("touch", "training", "both"), "there is no 'both'"),
    ],
)
def test_wrong_choices_are_refused(small_set, arguments, match):
    with pytest.raises(InputError, match=match):
        ObjectFolderDataset(small_set, *arguments)


def test_what_is_not_there_is_said(small_set, small_file, tmp_path):
    with pytest.raises(InputError, match="no objects with views"):
        ObjectFolderDataset(tmp_path)
    with pytest.raises(InputError, match="no truth"):
        ObjectFolderDataset([small_file])
    with pytest.raises(FileNotFoundError):
        ObjectFolderDataset([tmp_path / "x.safetensors"], source="object_file")
    with pytest.raises(InputError, match="there is no 'all'"):
        of(small_set, "touch", object_split="all")
    folder = tmp_path / "data/touches"
    folder.mkdir(parents=True)
    content = (small_set / "data/touches/bar.zarr.zip").read_bytes()
    (folder / "bar.zarr.zip").write_bytes(content[: len(content) // 2])
    with pytest.raises(FormatError, match="not a readable product"):
        ObjectFolderDataset(tmp_path, "touch")
    damaged = bytearray(content)
    start = content.index(b"rgb/c/4/")
    damaged[start + 200 : start + 260] = bytes(60)
    (folder / "bar.zarr.zip").write_bytes(damaged)
    samples = ObjectFolderDataset(tmp_path, "touch")
    with pytest.raises(FormatError, match="damaged array rgb"):
        [samples[index] for index in range(len(samples))] + [
            ObjectFolderDataset(tmp_path, "touch", "held_out")[index] for index in range(6)
        ]  # fmt: skip
    with pytest.raises(IndexError):
        samples[len(samples)]
