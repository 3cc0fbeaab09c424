"""The network and its training."""

import pytest
import torch

from learning.networks import Labelled, ResNet18, answers, fit_classifier
from learning.settings import Encoder

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
    assert sum(one.numel() for one in ResNet18(3, 1000).parameters()) == 11_689_512


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
    for seen in (inputs, 0.25 * inputs + shared):
        network.standardised.learn(seen)
        logs.append(answers(network, seen)[1])
    torch.testing.assert_close(*logs, atol=1e-4, rtol=0)
