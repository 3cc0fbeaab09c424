"""ResNet-18 (He et al. 2016), and its training as a classifier of objects."""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import nn
from torch.nn.functional import cross_entropy
from torch.utils.tensorboard import SummaryWriter

from learning.settings import Encoder

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
CHANNELS_LAST = torch.channels_last  # convolutions of few channels take three quarters of the time


class _Block(nn.Module):
    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.branch = nn.Sequential(
            nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(),
            nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False), nn.BatchNorm2d(outputs),
        )  # fmt: skip
        self.shortcut: nn.Module = nn.Identity()
        if stride > 1 or inputs != outputs:
            convolution = nn.Conv2d(inputs, outputs, 1, stride, bias=False)
            self.shortcut = nn.Sequential(convolution, nn.BatchNorm2d(outputs))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.relu(self.branch(x) + self.shortcut(x))


class _Standardised(nn.Module):
    """Subtract what all training samples share, as the picture of an untouched gel; scale what is left."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(1))
        self.register_buffer("scale", torch.ones(1))

    def learn(self, inputs: torch.Tensor) -> None:
        """Take the mean (channels, h, w) of inputs (n, channels, h, w), and one deviation from it."""
        self.mean = inputs.mean(dim=0)
        self.scale = inputs.var(dim=0).mean().sqrt() + 1e-6

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return ((x - self.mean) / self.scale).contiguous(memory_format=CHANNELS_LAST)


class ResNet18(nn.Module):
    """Images (n, channels, h, w) to logits (n, classes); `features` is the layer before, (n, 8 width)."""

    def __init__(self, channels: int, classes: int, width: int = 64) -> None:
        super().__init__()
        self.standardised = _Standardised()
        self.features = nn.Sequential(
            self.standardised,
            nn.Conv2d(channels, width, 7, 2, 3, bias=False), nn.BatchNorm2d(width), nn.ReLU(),
            nn.MaxPool2d(3, 2, 1),
            _Block(width, width, 1), _Block(width, width, 1),
            _Block(width, 2 * width, 2), _Block(2 * width, 2 * width, 1),
            _Block(2 * width, 4 * width, 2), _Block(4 * width, 4 * width, 1),
            _Block(4 * width, 8 * width, 2), _Block(8 * width, 8 * width, 1),
            nn.AdaptiveAvgPool2d(1), nn.Flatten(),
        )  # fmt: skip
        self.head = nn.Linear(8 * width, classes)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return logits (n, classes)."""
        return self.head(self.features(x))


@dataclass(frozen=True)
class Labelled:
    """Inputs (n, ...) float32 and labels (n,) int64."""

    inputs: torch.Tensor
    labels: torch.Tensor


def batches(count: int, size: int, random: torch.Generator) -> Iterator[torch.Tensor]:
    """Yield shuffled indices; a last batch of one row is left out, which batch normalisation cannot take."""
    for rows in torch.randperm(count, generator=random).split(size):
        if len(rows) > 1:
            yield rows


def fit_classifier(
    training: Labelled,
    validation: Labelled,
    classes: int,
    asked: Encoder,
    seed: int,
    log: SummaryWriter | None = None,
) -> ResNet18:
    """Train on one set, and return the epoch that is best on the other; the test set is never seen.

    Parameters
    ----------
    log
        Gets the losses of both sets after each epoch, for TensorBoard.
    """
    torch.manual_seed(seed)
    random = torch.Generator().manual_seed(seed)
    network = ResNet18(training.inputs.shape[1], classes, asked.width)
    network.standardised.learn(training.inputs)
    network.to(DEVICE)
    for weights in network.parameters():
        if weights.ndim == 4:
            weights.data = weights.data.contiguous(memory_format=CHANNELS_LAST)
    optimiser = torch.optim.AdamW(network.parameters(), asked.learning_rate, weight_decay=1e-2)
    steps = asked.epochs * max(1, -(-len(training.labels) // asked.batch))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, asked.learning_rate, total_steps=steps)
    best, best_loss = network.state_dict(), float("inf")
    for epoch in range(asked.epochs):
        network.train()
        losses = []
        for rows in batches(len(training.labels), asked.batch, random):
            logits = network(_on_device(training.inputs[rows]))
            loss = cross_entropy(logits, training.labels[rows].to(DEVICE), label_smoothing=0.05)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            losses.append(loss.item())
        loss_now = float(cross_entropy(answers(network, validation.inputs)[1], validation.labels))
        if log is not None:
            log.add_scalars("loss", {"training": sum(losses) / len(losses), "validation": loss_now}, epoch)
        if loss_now < best_loss:
            best_loss = loss_now
            best = {name: value.detach().clone() for name, value in network.state_dict().items()}
    network.load_state_dict(best)
    return network


def _on_device(inputs: torch.Tensor) -> torch.Tensor:
    return inputs.to(DEVICE).contiguous(memory_format=CHANNELS_LAST)


@torch.no_grad()
def answers(network: ResNet18, inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return features (n, 8 width) and log probabilities (n, classes), on the CPU."""
    network.eval()
    features = torch.cat([network.features(_on_device(part)) for part in inputs.split(128)])
    return features.cpu(), torch.log_softmax(network.head(features), dim=1).cpu()
