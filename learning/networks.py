"""ResNet-18 (He et al. 2016) of one sense or joined of several, a linear layer, and their training."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import nn
from torch.nn.functional import cross_entropy

from learning.settings import Encoder

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
JOINING = 128  # numbers of the layer that joins senses
PART = 1024  # samples whose sums are taken at a time
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
        # By parts: all of them as doubles would fill a memory.
        total = sum(part.double().sum(dim=0) for part in inputs.split(PART))
        mean = torch.as_tensor(total) / len(inputs)
        squares = sum((part.double() - mean).square().sum() for part in inputs.split(PART))
        variance = torch.as_tensor(squares) / (len(inputs) - 1) / mean.numel()
        self.mean, self.scale = mean.float(), variance.sqrt().float() + 1e-6

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return _laid_out((x - self.mean) / self.scale)


class LinearHead(nn.Module):
    """Features (n, count) of a network that is trained already to logits (n, classes)."""

    def __init__(self, count: int, classes: int) -> None:
        super().__init__()
        self.features = _Standardised()
        self.head = nn.Linear(count, classes)

    def learn(self, inputs: torch.Tensor) -> None:
        """Take what the training samples (n, count) share."""
        self.features.learn(inputs)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return logits (n, classes)."""
        return self.head(self.features(x))


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

    def learn(self, inputs: torch.Tensor) -> None:
        """Take what the training samples (n, channels, h, w) share."""
        self.standardised.learn(inputs)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return logits (n, classes)."""
        return self.head(self.features(x))


class JoinedSenses(nn.Module):
    """A `ResNet18` for each of several senses, whose features two layers join, trained as one.

    Parameters
    ----------
    channels
        Of each sense; they stand one after another in the channels of an input.
    """

    def __init__(self, channels: Sequence[int], classes: int, width: int = 64) -> None:
        super().__init__()
        self._channels = tuple(channels)
        self._networks = [ResNet18(count, JOINING, width) for count in channels]
        self.senses = nn.ModuleList(self._networks)
        self.head = nn.Sequential(nn.ReLU(), nn.Linear(JOINING, classes))

    def learn(self, inputs: torch.Tensor) -> None:
        """Take what the training samples (n, channels, h, w) share."""
        for network, part in zip(self._networks, inputs.split(self._channels, dim=1), strict=True):
            network.learn(part)

    def features(self, x: torch.Tensor) -> torch.Tensor:
        """Return (n, `JOINING`), the sum of what the senses say."""
        parts = x.split(self._channels, dim=1)
        outputs = [network(part) for network, part in zip(self._networks, parts, strict=True)]
        return torch.stack(outputs).sum(dim=0)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return logits (n, classes)."""
        return self.head(self.features(x))


Network = ResNet18 | JoinedSenses | LinearHead


@dataclass(frozen=True)
class Labelled:
    """Inputs (n, ...) float32 or float16, which networks take as float32, and labels (n,) int64."""

    inputs: torch.Tensor
    labels: torch.Tensor


def lay_out(network: nn.Module) -> None:
    """Bring the weights of a network to the device, laid out as its inputs are."""
    network.to(DEVICE)
    for weights in network.parameters():
        if weights.ndim == 4:
            weights.data = weights.data.contiguous(memory_format=CHANNELS_LAST)


def batches(count: int, size: int, random: torch.Generator) -> Iterator[torch.Tensor]:
    """Yield shuffled indices; a last batch of one row is left out, which batch normalisation cannot take."""
    for rows in torch.randperm(count, generator=random).split(size):
        if len(rows) > 1:
            yield rows


def fit_classifier(
    training: Labelled,
    validation: Labelled,
    classes: int,
    parameters: Encoder,
    seed: int,
    log: "SummaryWriter | None" = None,
    senses: Sequence[int] | None = None,
) -> Network:
    """Train on one set, and return the epoch that is best on the other; the test set is never seen.

    Inputs (n, channels, h, w) are told apart by a ResNet, features (n, count) by a linear layer.

    Parameters
    ----------
    senses
        Channels of each, for `JoinedSenses`; all channels are one sense if None.
    log
        Gets the losses of both sets after each epoch, for TensorBoard.
    """
    torch.manual_seed(seed)
    random = torch.Generator().manual_seed(seed)
    network: Network
    if training.inputs.ndim == 2:
        network = LinearHead(training.inputs.shape[1], classes)
    elif senses is None:
        network = ResNet18(training.inputs.shape[1], classes, parameters.width)
    else:
        network = JoinedSenses(senses, classes, parameters.width)
    network.learn(training.inputs)
    lay_out(network)
    optimiser = torch.optim.AdamW(network.parameters(), parameters.learning_rate, weight_decay=1e-2)
    steps = parameters.epochs * max(1, -(-len(training.labels) // parameters.batch))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, parameters.learning_rate, total_steps=steps)
    best, best_loss = network.state_dict(), float("inf")
    for epoch in range(parameters.epochs):
        network.train()
        losses = []
        for rows in batches(len(training.labels), parameters.batch, random):
            logits = network(on_device(training.inputs[rows]))
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


def on_device(inputs: torch.Tensor) -> torch.Tensor:
    """Return inputs as networks take them: float32, where and as they lie in memory."""
    return _laid_out(inputs.to(DEVICE).float())


def _laid_out(inputs: torch.Tensor) -> torch.Tensor:
    return inputs.contiguous(memory_format=CHANNELS_LAST) if inputs.ndim == 4 else inputs


@torch.no_grad()
def answers(network: Network, inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return features (n, 8 width), (n, `JOINING`) or (n, count), and log probabilities, on the CPU."""
    network.eval()
    features = torch.cat([network.features(on_device(part)) for part in inputs.split(128)])
    return features.cpu(), torch.log_softmax(network.head(features), dim=1).cpu()
