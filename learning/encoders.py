"""One network a sense, trained to name the object, and what it makes of every sample.

Tasks work on its features. A protocol says what it is trained and tested on:

- ``sample``: other draws of the same objects, as published;
- ``region``: test places lie in regions without a training place;
- ``vertex``: touches at vertices of the surface, all as deep, other vertices for each split: the touches of
  ObjectFolder 1.0, as many of an object as `TouchAtVertices` asks for where it has these;
- ``vertex region``: the touches of ``vertex``, but test places lie in regions without a training place;
- ``one lamp``: as ``sample``, but images have one lamp anywhere, as the published views;
- ``unseen``: networks are trained on other objects than those that are tested. All folds share the draws of
  ``sample`` with the first seed: only who is trained on differs.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import KDTree
from torch.nn.functional import adaptive_avg_pool2d

from learning.folds import folds_of
from learning.meshes import Meshes
from learning.networks import PART, Labelled, Network, answers, fit_classifier
from learning.pretrained import NAME, pretrained_features
from learning.runs import LOGS, Objects, kept
from learning.samples import Choice, Samples, Source, draw, regions_of
from learning.settings import Settings
from learning.vertices import AT_VERTICES, touched_vertices
from learning.workers import Workers
from objectfolder.products.provenance import seed_from

SPLITS = ("training", "validation", "test")
AVERAGED = 8  # rows and columns
NetworkKey = tuple[str, str, int]
Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Encoded:
    """What a network makes of the samples of a split.

    Attributes
    ----------
    features : (n, 8 width) float32, or (n, 1280) of a pretrained network
    log_probabilities : (n, classes) float32
    labels : (n,) int64, positions in `Objects.ids`
    averaged_inputs : (n, channels `AVERAGED`^2) float32, what a sample shows without any training; (n, 0)
        where features are given
    """

    features: NDArray[np.float32]
    log_probabilities: NDArray[np.float32]
    labels: NDArray[np.int64]
    averaged_inputs: NDArray[np.float32]

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]], prefix: str) -> "Encoded":
        """Return a split of `packed`, whose names begin with a prefix, as ``"test/"``."""
        names = ("features", "logs", "labels", "averaged")
        return cls(*(arrays[prefix + name] for name in names))


@dataclass(frozen=True)
class Encoder:
    """A trained sense: a split's name to what the network makes of it.

    Attributes
    ----------
    splits : by `SPLITS`
    nearest_share : median distance from a test place to the nearest training place of its object, over the
        object's longest side (for images, in units of the sphere's radius): how near duplicates are
    """

    splits: dict[str, Encoded]
    nearest_share: float


def encoded(
    objects: Objects | Meshes,
    settings: Settings,
    sense: str,
    protocol: str,
    seed: int,
    unseen: Sequence[int] = (),
    pretrained: bool = False,
) -> Encoder:
    """Train the network of a sense, or read what it was.

    Parameters
    ----------
    unseen
        Positions of objects that the network is not trained on; the test split is theirs alone. Empty for
        the other protocols.
    pretrained
        Whether only a linear layer is trained, on features of images by `learning.pretrained`.
    """
    key = {
        "unit": "encoder", "sense": sense, "protocol": protocol, "seed": seed, "unseen": list(unseen),
        "shared_draws": settings.seeds[0] if unseen else None,
        "data": settings.data.model_dump(exclude={"root", "objects"}),
        "encoder": settings.encoder.model_dump(), "files": objects.digests,
    }  # fmt: skip
    if protocol in AT_VERTICES:
        key["touch_at_vertices"] = settings.touch_at_vertices.model_dump(exclude={"finer_resolution"})
    if pretrained:
        key["pretrained"] = NAME
    stored = kept(__name__, key, lambda: _train(objects, settings, sense, protocol, seed, unseen, pretrained))
    return _unpacked(stored)


def train(
    objects: Objects,
    settings: Settings,
    workers: Workers,
    keys: Sequence[NetworkKey],
    unseen: Sequence[str] = (),
    folds: int | None = None,
    pretrained: Sequence[NetworkKey] = (),
) -> None:
    """Train networks side by side, so that `encoded` reads them; one worker trains those that share draws.

    Parameters
    ----------
    keys
        (sense, protocol, seed) each.
    unseen
        Senses whose networks of unseen objects are trained as well.
    folds
        How many folds of those; all if None.
    pretrained
        Of `keys`, those whose samples a pretrained network is shown as well.
    """
    by_draws: dict[NetworkKey, list[tuple[Any, ...]]] = {key: [key] for key in keys}
    several = list(enumerate(folds_of(objects, settings)))[:folds]
    for sense in unseen:
        networks = [(sense, "unseen", fold, tuple(out)) for fold, out in several]
        by_draws.setdefault((sense, "sample", settings.seeds[0]), []).extend(networks)
    for key in pretrained:
        by_draws[key].append((*key, (), True))
    workers.gather([workers.submit(_trained, objects, settings, group) for group in by_draws.values()])


def _trained(objects: Objects, settings: Settings, group: Sequence[Any]) -> None:
    for network in group:
        encoded(objects, settings, *network)


def _train(
    objects: Objects | Meshes,
    settings: Settings,
    sense: str,
    protocol: str,
    seed: int,
    unseen: Sequence[int],
    pretrained: bool,
) -> Arrays:
    samples, nearest = samples_of(objects, settings, sense, protocol, seed, unseen)
    parameters = settings.encoder
    if protocol in AT_VERTICES:
        own = settings.touch_at_vertices
        training = {"epochs": own.epochs, "batch": own.batch, "learning_rate": own.learning_rate}
        parameters = parameters.model_copy(update=training)
    if pretrained:
        samples = {
            split: Labelled(pretrained_features(part.inputs), part.labels) for split, part in samples.items()
        }
    from torch.utils.tensorboard import SummaryWriter

    name = f"{NAME if pretrained else sense} {protocol} {seed}"
    with SummaryWriter(LOGS / name) as log:
        network = fit_classifier(
            samples["training"], samples["validation"], len(objects), parameters, seed, log
        )
    return {**packed(network, samples), "nearest": np.array(nearest)}


def samples_of(
    objects: Objects | Meshes, settings: Settings, sense: str, protocol: str, seed: int, unseen: Sequence[int]
) -> tuple[dict[str, Labelled], float]:
    """Draw what the network of a sense is trained and tested on, as `drawn`; see `encoded`."""
    if protocol != "unseen":
        return drawn(objects, settings, sense, protocol, seed)
    samples, nearest = drawn(objects, settings, sense, "sample", settings.seeds[0])
    out = torch.tensor(list(unseen))
    samples_by_split = {
        split: Labelled(part.inputs[chosen], part.labels[chosen])
        for split, part in samples.items()
        for chosen in [torch.isin(part.labels, out) == (split == "test")]
    }
    return samples_by_split, nearest


def packed(network: Network, samples: dict[str, Labelled]) -> Arrays:
    """Return what `Encoded` has of every split, as arrays with names."""
    arrays: Arrays = {}
    for split, part in samples.items():
        features, logs = answers(network, part.inputs)
        arrays |= {f"{split}/features": features.numpy(), f"{split}/logs": logs.numpy()}
        arrays[f"{split}/labels"] = part.labels.numpy()
        arrays[f"{split}/averaged"] = _averaged(part.inputs).numpy()
    return arrays


def _averaged(inputs: torch.Tensor) -> torch.Tensor:
    if inputs.ndim == 2:
        return inputs.new_zeros(len(inputs), 0)
    return torch.cat([adaptive_avg_pool2d(rows.float(), AVERAGED) for rows in inputs.split(PART)]).flatten(1)


def _unpacked(arrays: Arrays) -> Encoder:
    splits = {split: Encoded.of_arrays(arrays, f"{split}/") for split in SPLITS}
    return Encoder(splits, float(arrays["nearest"]))


@lru_cache(maxsize=1)
def drawn(
    objects: Objects | Meshes, settings: Settings, sense: str, protocol: str, seed: int
) -> tuple[dict[str, Labelled], float]:
    """Draw the samples of all objects: inputs and labels by split, and how near test is to training."""
    inputs: dict[str, list[torch.Tensor]] = {split: [] for split in SPLITS}
    nearest = []
    for samples in object_draws(objects, settings, sense, protocol, seed, SPLITS):
        gaps, _ = KDTree(samples["training"].places).query(samples["test"].places)
        nearest.append(np.median(gaps) / samples["test"].extent)
        for split, part in samples.items():
            inputs[split].append(part.inputs)
    labelled = {
        split: Labelled(
            torch.cat(parts),
            torch.arange(len(objects)).repeat_interleave(torch.tensor([len(part) for part in parts])),
        )
        for split, parts in inputs.items()
    }
    return labelled, float(np.median(nearest))


def object_draws(
    objects: Objects | Meshes,
    settings: Settings,
    sense: str,
    protocol: str,
    seed: int,
    splits: Sequence[str],
) -> Iterator[dict[str, Samples]]:
    """Yield the samples of each object by split, so that one file is open at a time."""
    data = settings.data
    counts = {
        "training": getattr(data.training, sense), "validation": data.validation, "test": data.test
    }  # fmt: skip
    for name in objects.ids:
        file: Source = objects.files[name]
        if protocol in AT_VERTICES:
            yield touched_vertices(file, name, objects.digests[name], settings, protocol, seed, splits)
            continue
        regions: tuple[Choice, Choice] | None = None
        if protocol == "region":
            regions = regions_of(file, sense, data.regions, seed_from(seed, "regions", name))
        yield {
            split: draw(
                file,
                sense,
                counts[split],
                seed_from(seed, f"{sense} {protocol} {split}", name),
                getattr(data.resolution, sense),
                chosen=None if regions is None else regions[split == "test"],
                lit=protocol != "one lamp",
            )
            for split in splits
        }
