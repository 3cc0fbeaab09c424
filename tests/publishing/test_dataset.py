"""Truth and Object Files as PyTorch samples: the same queries, the same keys, in any kind of worker."""

import pickle
import shutil
import zipfile

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

import objectfolder
from objectfolder.dataset import ObjectFolderDataset, reading
from objectfolder.errors import FormatError, InputError
from objectfolder.fidelity.images import psnr_db
from objectfolder.fidelity.sound import sound_pairs
from objectfolder.products.splits import object_split
from objectfolder.products.store import read_product
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


def equal(one, other):
    return one.keys() == other.keys() and all(
        torch.equal(value, other[key]) if torch.is_tensor(value) else value == other[key]
        for key, value in one.items()
    )


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
    one, other = truth[index], answer[index]
    for key in ("camera_to_object", "light_position_m", "point_m", "impulse_n_s", "press_depth_m", "query"):
        if key in one:
            assert np.array_equal(one[key], other[key])
    if sense == "audio":
        error = (one["sound"] - other["sound"]).norm() / one["sound"].norm()
        assert error < 0.3  # fitted to 120 points; the sound of another point is 1 or more off
        return
    pictures = [(255 * entry["image"].numpy()).round().astype(np.uint8) for entry in (one, other)]
    assert psnr_db(*pictures) > 25
    assert (one["mask"] == other["mask"]).float().mean() > 0.99
    both = one["mask"] & other["mask"]
    assert both.any()
    assert torch.allclose(one["depth_m"][both], other["depth_m"][both], atol=3e-4)


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


def test_sounds_are_those_that_fidelity_compares(small_set):
    file = objectfolder.load(small_set / "data/object_files/bar.safetensors")
    pairs = sound_pairs(file, read_product(small_set / "data/modes/bar.zarr.zip"))
    for source, sounds in zip(("truth", "object_file"), pairs, strict=True):
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
    loader = DataLoader(samples, batch_size=4, num_workers=2, multiprocessing_context=context, timeout=300)
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
    assert {name for name, _ in read} == {"held_out"}
    read.clear()
    samples[3]
    images = {name: selection for name, selection in read if name in ("rgb", "depth", "mask")}
    assert images == dict.fromkeys(("rgb", "depth", "mask"), samples[3]["query"])


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
    other = ObjectFolderDataset([small_file], sense, "held_out", **settings)
    assert len(samples) == 3
    key = "camera_to_object" if sense == "vision" else "point_m"
    assert all(equal(samples[index], again[index]) for index in range(3))
    assert not torch.equal(samples[0][key], other[0][key])
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
        wanted = [name for name in ("bar", "rod") if object_split(name, "glass") == part]
        assert of(small_set, "touch", object_split=part).object_ids == wanted
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
