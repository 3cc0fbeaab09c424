"""A space in which what two senses tell of an object lies together, and its training."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn.functional import nll_loss, normalize

from learning.encoders import Encoded
from learning.metrics import mean_average_precision
from learning.networks import batches
from learning.recognition import aligned
from learning.settings import Retrieval

Floats = NDArray[np.float64]
Pair = tuple[Encoded, Encoded]  # of two senses
PAIRINGS = 4  # of training samples, each with others of its object
BATCH = 64
HIDDEN = 128  # numbers between the layers of a head


class CommonSpace(nn.Module):
    """Two heads that say how likely each known object is; places are the square roots of that.

    They are unit vectors, and the cosine of two is the coefficient of Bhattacharyya (1943): a touch that fits
    ten objects lies between them, where a linear space has it near one of them.
    """

    def __init__(self, inputs: Sequence[int], classes: int, parameters: Retrieval) -> None:
        super().__init__()
        self._margin = parameters.margin
        self.scales = nn.ModuleList(nn.BatchNorm1d(size) for size in inputs)
        self.heads = nn.ModuleList(nn.Linear(size, classes) for size in inputs)

    def log_probabilities(self, side: int, features: torch.Tensor) -> torch.Tensor:
        """Return (n, classes)."""
        return torch.log_softmax(self.heads[side](self.scales[side](features)), dim=1)

    def forward(self, side: int, features: torch.Tensor) -> torch.Tensor:
        """Return unit vectors (n, classes)."""
        return (self.log_probabilities(side, features) / 2).exp()

    def loss(self, features: Sequence[torch.Tensor], labels: torch.Tensor) -> torch.Tensor:
        """Return the loss of a batch: triplets of both directions, and the names of both senses."""
        logs = [self.log_probabilities(side, part) for side, part in enumerate(features)]
        places = [(log / 2).exp() for log in logs]
        parts = [_triplets(places[i], places[1 - i], labels, self._margin) for i in (0, 1)]
        return torch.stack([*parts, *(nll_loss(log, labels) for log in logs)]).sum()


def _triplets(
    anchors: torch.Tensor, candidates: torch.Tensor, labels: torch.Tensor, margin: float
) -> torch.Tensor:
    """Return the mean triplet loss with the farthest positive and the nearest negative of a batch."""
    similarity = anchors @ candidates.T
    same = labels[:, None] == labels
    positive = similarity.masked_fill(~same, 2).amin(dim=1)
    negative = similarity.masked_fill(same, -2).amax(dim=1)
    return torch.relu(negative - positive + margin).mean()


class ContrastiveSpace(nn.Module):
    """Two heads that bring the features of two senses to unit vectors of one space, whose axes are free.

    They learn by the supervised contrastive loss (InfoNCE of van den Oord et al. 2018, with several positives
    as Khosla et al. 2020, equation 2): see `contrasted`.
    """

    def __init__(self, inputs: Sequence[int], classes: int, parameters: Retrieval) -> None:
        super().__init__()
        self._temperature = parameters.temperature
        self.heads = nn.ModuleList(
            nn.Sequential(
                nn.BatchNorm1d(size), nn.Linear(size, HIDDEN), nn.ReLU(),
                nn.Linear(HIDDEN, parameters.dimensions),
            )
            for size in inputs
        )  # fmt: skip

    def forward(self, side: int, features: torch.Tensor) -> torch.Tensor:
        """Return unit vectors (n, dimensions)."""
        return normalize(self.heads[side](features), dim=1)

    def loss(self, features: Sequence[torch.Tensor], labels: torch.Tensor) -> torch.Tensor:
        """Return the loss of a batch: features of both senses, a row of each of the same object."""
        first, second = (self(side, part) for side, part in enumerate(features))
        ways = [
            contrasted(*places, labels, self._temperature) for places in ((first, second), (second, first))
        ]
        return torch.stack(ways).sum()


def contrasted(
    anchors: torch.Tensor, candidates: torch.Tensor, labels: torch.Tensor, temperature: float
) -> torch.Tensor:
    """Return the mean surprise at the candidates of an anchor's object, of all candidates of a batch.

    Parameters
    ----------
    anchors, candidates
        (n, dimensions) unit vectors of two senses.
    labels
        (n,) of both: candidates of other objects are the negatives.
    """
    same = labels[:, None] == labels
    logs = torch.log_softmax(anchors @ candidates.T / temperature, dim=1)
    return -((logs * same).sum(dim=1) / same.sum(dim=1)).mean()


Space = CommonSpace | ContrastiveSpace
SPACES: dict[str, type[Space]] = {"ours": CommonSpace, "contrastive": ContrastiveSpace}


def fit_common_space(
    training: Pair,
    validation: Pair,
    classes: int,
    parameters: Retrieval,
    seed: int,
    kind: type[Space] = CommonSpace,
) -> Space:
    """Train the heads, and return the epoch with the best mAP of both directions in the validation split."""
    torch.manual_seed(seed)
    random = torch.Generator().manual_seed(seed)
    sizes = [encoding.features.shape[1] for encoding in training]
    features, labels = aligned(training, PAIRINGS, seed)
    space = kind(sizes, classes, parameters)
    optimiser = torch.optim.AdamW(space.parameters(), 5e-3, weight_decay=1e-2)
    steps = parameters.epochs * -(-len(labels) // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 5e-3, total_steps=steps)
    best, best_score = space.state_dict(), -1.0
    for _ in range(parameters.epochs):
        space.train()
        for rows in batches(len(labels), BATCH, random):
            loss = space.loss(features[rows].split(sizes, dim=1), labels[rows])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
        score = np.mean(
            [
                mean_average_precision(similarity, queries.labels, gallery.labels, seed)
                for similarity, queries, gallery in both_ways(space, validation)
            ]
        )
        if score > best_score:
            best_score = float(score)
            best = {name: value.clone() for name, value in space.state_dict().items()}
    space.load_state_dict(best)
    return space


@torch.no_grad()
def both_ways(space: Space, pair: Pair) -> list[tuple[Floats, Encoded, Encoded]]:
    """Return similarity (queries, gallery), queries and gallery of both directions."""
    space.eval()
    places = [space(side, torch.from_numpy(encoding.features)) for side, encoding in enumerate(pair)]
    similarity = (places[0] @ places[1].T).double().numpy()
    return [(similarity, *pair), (similarity.T, pair[1], pair[0])]
