"""Sizes of the network's parts, apart from torch so that opening an Object File checks them at once."""

from collections.abc import Collection, Sequence
from itertools import pairwise

LAYER_WIDTH = 64
# Features a corner of each level holds, coarse to fine.
FEATURES = (8, 8, 4, 3)
# The coarse levels that the bounced light may depend on: finer ones would fit the renderer's noise.
COARSE_LEVELS = 2
ANGLES = 12
SURROUNDINGS = 31
# Cosines of light and camera in the highlight's masking are at least this: finite at grazing angles.
LEAST_COSINE = 0.01
# The weight that tells a network with mirrors: GGX width of the highlight as it is seen in the surface.
MIRROR_WIDTH = "log_mirror_alpha"


def has_mirrors(names: Collection[str]) -> bool:
    """Whether weights of these names belong to a network that shows the surface in itself."""
    return MIRROR_WIDTH in names


def weight_shapes(sizes: Sequence[int], mirrors: bool = False) -> dict[str, tuple[int, ...]]:
    """Return the shape of each weight of `reflectance.Reflectance` by name.

    Parameters
    ----------
    sizes
        Corners of each grid level, coarse to fine.
    mirrors
        Whether the network shows the surface in itself.
    """
    features = sum(FEATURES)
    shapes: dict[str, tuple[int, ...]] = {"log_alpha": ()}
    for level, size in enumerate(sizes):
        shapes[f"tables.{level}"] = (size, FEATURES[level])
    layers = {
        "direct": (features + ANGLES, LAYER_WIDTH, LAYER_WIDTH, 6),
        "bounced": (sum(FEATURES[:COARSE_LEVELS]) + SURROUNDINGS, LAYER_WIDTH, LAYER_WIDTH, 3),
    }
    for name, widths in layers.items():
        for index, (inputs, outputs) in enumerate(pairwise(widths)):
            shapes[f"{name}.{2 * index}.weight"] = (outputs, inputs)
            shapes[f"{name}.{2 * index}.bias"] = (outputs,)
    shapes["albedo.weight"], shapes["albedo.bias"] = (3, features + 3), (3,)
    if mirrors:
        shapes[MIRROR_WIDTH] = ()
        shapes["facing.weight"], shapes["facing.bias"] = (3, features), (3,)
    return shapes
