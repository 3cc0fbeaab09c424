"""The network and its training."""

import numpy as np
import pytest
import torch

from learning.end_to_end import fit_pair, similarity_of
from learning.metrics import mean_average_precision
from learning.networks import Labelled, ResNet18, answers, fit_classifier
from learning.pretrained import answers_of, imagenet_network, pretrained_features
from learning.settings import Encoder
from objectfolder import example

COFFEE_MUG = 504  # of the classes of ImageNet
ASKED = Encoder(width=8, epochs=4, batch=16, learning_rate=5e-3)


def stripes(count: int, seed: int) -> Labelled:
    """Noise with stripes along one axis or the other."""
    random = torch.Generator().manual_seed(seed)
    labels = torch.arange(count) % 2
    wave = torch.sin(torch.arange(32.0))
    across = wave.expand(32, 32)
    inputs = torch.stack([across if label else across.T for label in labels])[:, None]
    return Labelled(inputs + torch.randn(inputs.shape, generator=random), labels)


def test_resnet_18_has_the_parameters_of_resnet_18():
    assert sum(weights.numel() for weights in ResNet18(3, 1000).parameters()) == 11_689_512


@pytest.mark.slow
def test_a_classifier_learns_what_can_be_learned_and_gives_the_same_bits_again():
    sets = stripes(192, 0), stripes(32, 1)
    logs = [answers(fit_classifier(*sets, 2, ASKED, seed=3), stripes(64, 2).inputs)[1] for _ in range(2)]
    assert torch.equal(*logs)
    assert (logs[0].argmax(dim=1) == stripes(64, 2).labels).float().mean() > 0.9


@pytest.mark.slow
def test_two_senses_tell_together_what_neither_tells_alone():
    """Whether both have stripes along the first axis."""

    def pairs(count: int, seed: int) -> Labelled:
        first, second = (stripes(count, seed + side) for side in (0, 1))
        order = torch.randperm(count, generator=torch.Generator().manual_seed(seed))
        inputs = torch.cat([first.inputs, second.inputs[order]], dim=1)
        return Labelled(inputs, first.labels * second.labels[order])

    longer = ASKED.model_copy(update={"epochs": 8})
    network = fit_classifier(pairs(256, 0), pairs(32, 2), 2, longer, seed=3, senses=(1, 1))
    test = pairs(100, 4)
    assert (answers(network, test.inputs)[1].argmax(dim=1) == test.labels).float().mean() > 0.9
    blind = test.inputs * torch.tensor([1.0, 0.0])[:, None, None]
    assert (answers(network, blind)[1].argmax(dim=1) == test.labels).float().mean() < 0.8


@pytest.mark.slow
def test_a_pair_of_networks_learns_to_find_one_sense_by_the_other_and_gives_the_same_bits_again(tiny):
    """A sense shows stripes of one of two widths, the other which of its halves is bright."""

    def pair(count: int, seed: int) -> tuple[Labelled, Labelled]:
        random = torch.Generator().manual_seed(seed)
        labels = torch.arange(count) % 2
        waves = torch.stack([torch.sin(torch.arange(32.0) * width).expand(32, 32) for width in (1.0, 0.3)])
        halves = torch.ones(2, 32, 32)
        halves[0, :16] = halves[1, 16:] = 0
        senses = (shown[labels][:, None] for shown in (waves, halves))
        first, second = (
            Labelled(inputs + torch.randn(inputs.shape, generator=random), labels) for inputs in senses
        )
        return first, second

    settings = tiny.model_copy(update={"encoder": ASKED.model_copy(update={"epochs": 25})})
    test = pair(40, 2)
    results = [similarity_of(fit_pair(pair(192, 0), pair(32, 1), settings, seed=3), test) for _ in range(2)]
    np.testing.assert_array_equal(*results)
    labels = [part.labels.numpy() for part in test]
    assert mean_average_precision(results[0], *labels, seed=0) > 0.95


def test_a_layer_on_features_takes_only_features():
    random = torch.Generator().manual_seed(0)
    labels = torch.arange(64) % 2
    features = torch.randn(64, 12, generator=random)
    features[:, 0] += 4 * labels
    network = fit_classifier(
        Labelled(features, labels), Labelled(features, labels), 2, ASKED.model_copy(update={"epochs": 80}), 0
    )
    assert sum(weights.numel() for weights in network.parameters()) == 2 * 12 + 2
    assert (answers(network, features)[1].argmax(dim=1) == labels).float().mean() > 0.9


def test_pretrained_features_do_not_depend_on_the_batch():
    images = torch.rand(3, 3, 16, 16, generator=torch.Generator().manual_seed(0))
    features = pretrained_features(images)
    assert features.shape == (3, 1280)
    torch.testing.assert_close(pretrained_features(images[1:2])[0], features[1], atol=1e-4, rtol=1e-3)


@pytest.mark.slow
def test_the_network_of_imagenet_knows_a_mug():
    file = example("mug")
    images = file.render(*file.sample_views(6, seed=0, lit=True), 128, sub_rays=4)
    logits = answers_of(torch.from_numpy(images).permute(0, 3, 1, 2) / 255, imagenet_network())
    assert (logits.topk(5).indices == COFFEE_MUG).any(dim=1).sum() >= 3


def test_answers_do_not_depend_on_the_batch():
    network, inputs = ResNet18(1, 2, 8), stripes(8, 0).inputs
    features, logs = answers(network, inputs)
    alone = answers(network, inputs[3:4])
    assert features.shape == (8, 64)
    torch.testing.assert_close(features[3:4], alone[0])
    torch.testing.assert_close(logs.exp().sum(dim=1), torch.ones(8))


def test_what_all_samples_share_and_their_contrast_say_nothing():
    network, inputs, logs = ResNet18(1, 2, 8), stripes(64, 0).inputs, []
    shared = torch.rand(1, 32, 32, generator=torch.Generator().manual_seed(0))
    for batch in (inputs, 0.25 * inputs + shared):
        network.standardised.learn(batch)
        logs.append(answers(network, batch)[1])
    torch.testing.assert_close(*logs, atol=1e-4, rtol=0)
