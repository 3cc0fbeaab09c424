"""Two networks that bring samples of two senses to one space, trained together to find one by the other.

`common_space` learns from features of networks that were trained to name the known objects. These networks
are trained for retrieval alone: nothing in them stands for a known object.
"""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import normalize

from learning.common_space import contrasted
from learning.encoders import SPLITS, samples_of
from learning.metrics import mean_average_precision
from learning.networks import Labelled, ResNet18, answers, batches, lay_out, on_device
from learning.runs import Objects, kept
from learning.settings import Settings

BATCH = 128  # pairs, each with the others as negatives
Networks = tuple[ResNet18, ResNet18]
Pair = tuple[Labelled, Labelled]


def end_to_end_similarity(
    objects: Objects,
    settings: Settings,
    senses: tuple[str, str],
    protocol: str,
    seed: int,
    unseen: Sequence[int],
) -> NDArray[np.float64]:
    """Return the similarity (first, second) of the test samples of two senses, in the order of `encoded`.

    Parameters
    ----------
    protocol, seed, unseen
        As `learning.encoders.encoded`.
    """
    key = {
        "unit": "end to end", "senses": senses, "protocol": protocol, "seed": seed, "unseen": list(unseen),
        "shared_draws": settings.seeds[0] if unseen else None,
        "data": settings.data.model_dump(exclude={"root", "objects"}),
        "encoder": settings.encoder.model_dump(), "files": objects.digests,
        "retrieval": settings.retrieval.model_dump(exclude={"end_to_end_folds"}),
    }  # fmt: skip

    def compute() -> dict[str, NDArray[np.float64]]:
        first, second = (samples_of(objects, settings, sense, protocol, seed, unseen)[0] for sense in senses)
        training, validation, test = ((first[split], second[split]) for split in SPLITS)
        networks = fit_pair(training, validation, settings, seed)
        return {"similarity": similarity_of(networks, test)}

    return kept(__name__, key, compute)["similarity"]


def fit_pair(training: Pair, validation: Pair, settings: Settings, seed: int) -> Networks:
    """Train two networks by the supervised contrastive loss, and return the epoch that is best in validation.

    A sample of the first sense is paired with one of the second that is of the same object, drawn anew in
    each epoch.
    """
    torch.manual_seed(seed)
    random = torch.Generator().manual_seed(seed)
    parameters, retrieval = settings.encoder, settings.retrieval
    first, second = (
        ResNet18(part.inputs.shape[1], retrieval.dimensions, parameters.width) for part in training
    )
    networks = first, second
    for network, part in zip(networks, training, strict=True):
        network.learn(part.inputs)
        lay_out(network)
    weights = [weight for network in networks for weight in network.parameters()]
    optimiser = torch.optim.AdamW(weights, parameters.learning_rate, weight_decay=1e-2)
    steps = parameters.epochs * -(-len(training[0].labels) // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, parameters.learning_rate, total_steps=steps)
    other_labels = training[1].labels
    rows_of = {int(label): torch.nonzero(other_labels == label)[:, 0] for label in other_labels.unique()}
    best, best_score = [network.state_dict() for network in networks], -1.0
    for _ in range(parameters.epochs):
        for network in networks:
            network.train()
        for rows in batches(len(training[0].labels), BATCH, random):
            labels = training[0].labels[rows]
            partners = torch.stack([_one_of(rows_of[int(label)], random) for label in labels])
            places = [
                normalize(network(on_device(part.inputs[own])), dim=1)
                for network, part, own in zip(networks, training, (rows, partners), strict=True)
            ]
            own_labels = labels.to(places[0].device)
            loss = contrasted(places[0], places[1], own_labels, retrieval.temperature)
            loss = loss + contrasted(places[1], places[0], own_labels, retrieval.temperature)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
        score = _score(networks, validation, seed)
        if score > best_score:
            best_score = score
            best = [
                {name: value.detach().clone() for name, value in network.state_dict().items()}
                for network in networks
            ]
    for network, state in zip(networks, best, strict=True):
        network.load_state_dict(state)
    return networks


def _one_of(rows: torch.Tensor, random: torch.Generator) -> torch.Tensor:
    return rows[torch.randint(len(rows), (), generator=random)]


def similarity_of(networks: Networks, pair: Pair) -> NDArray[np.float64]:
    """Return the cosine (first, second) of the samples of two senses."""
    places = []
    for network, part in zip(networks, pair, strict=True):
        features, _ = answers(network, part.inputs)
        with torch.no_grad():
            places.append(normalize(network.head(on_device(features)), dim=1).cpu())
    return (places[0] @ places[1].T).double().numpy()


def _score(networks: Networks, pair: Pair, seed: int) -> float:
    similarity = similarity_of(networks, pair)
    labels = [part.labels.numpy() for part in pair]
    ways = ((similarity, labels[0], labels[1]), (similarity.T, labels[1], labels[0]))
    return float(np.mean([mean_average_precision(*way, seed) for way in ways]))
