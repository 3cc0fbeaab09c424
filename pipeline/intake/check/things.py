"""What things of a name are like: how long they are, and of what.

Wide on purpose: what lies outside is doubtful, not what lies at the edge.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.intake.check.words import is_word

PLASTICS = frozenset({"plastic", "polycarbonate"})
METALS = frozenset({"steel", "iron"})
METAL_TOOLS = METALS | PLASTICS | {"wood"}


@dataclass(frozen=True)
class Thing:
    """A kind of thing.

    Parameters
    ----------
    words
        Its names, in the singular.
    shortest_m, longest_m
        Range of its longest side.
    materials
        Of the table of materials, what it is mostly made of; None where it may be of anything.
    """

    words: tuple[str, ...]
    shortest_m: float
    longest_m: float
    materials: frozenset[str] | None = None


THINGS = (
    Thing(("die", "dice"), 0.004, 0.12),
    Thing(("coin",), 0.008, 0.06),
    Thing(("can",), 0.03, 1.2, METALS | PLASTICS),
    Thing(("mug", "cup", "ramekin", "teacup", "tumbler"), 0.03, 0.5),
    Thing(("bowl", "saucer", "plate", "dish"), 0.05, 0.6),
    Thing(("spoon", "fork", "knife", "spatula", "ladle", "whisk"), 0.06, 0.6),
    Thing(("bottle", "jar", "vase", "jug", "pitcher", "teapot", "kettle"), 0.03, 0.8),
    Thing(("pan", "frypan", "skillet", "saucepan"), 0.1, 0.8, METALS | {"ceramic", "glass"}),
    Thing(("toaster",), 0.12, 0.7, METALS | PLASTICS),
    Thing(("wrench", "pliers", "spanner"), 0.05, 0.8, METALS | PLASTICS),
    Thing(("hammer", "screwdriver", "scissor"), 0.05, 0.8, METAL_TOOLS),
    Thing(("padlock",), 0.02, 0.2, METALS | PLASTICS),
    Thing(("television", "tv", "monitor", "radio"), 0.05, 2.5, PLASTICS | {"wood", "glass"}),
    Thing(("keyboard", "telephone", "phone", "router", "megaphone"), 0.05, 0.7, PLASTICS | METALS),
    Thing(("lego", "duplo"), 0.007, 0.8, PLASTICS),
    Thing(("figure", "figurine", "doll"), 0.02, 1.0, PLASTICS | {"ceramic", "wood", "glass"}),
    Thing(("ukulele", "guitar", "violin"), 0.2, 1.5, PLASTICS | {"wood"}),
    Thing(("chair", "stool"), 0.25, 2.6),
    Thing(("cabinet", "commode", "wardrobe", "nightstand", "sofa", "bed"), 0.3, 4.0),
    Thing(("apple", "banana", "lemon", "pear", "strawberry"), 0.015, 0.35),
)

_SMALL = ("toy", "dollhouse", "miniature", "mini", "doll", "model", "minifigure")
"""Words of things that may have any size and be of anything."""

_FOR_IT = (
    "holder", "case", "opener", "rack", "stand", "block", "brush", "lid", "rest", "cover", "mat", "box",
    "bag", "tray", "set", "cutter", "sharpener", "sorter", "drainer",
)  # fmt: skip
"""Words after that of a thing, that name something else: a knife block, a can opener."""


def thing_named(words: Sequence[str]) -> tuple[str, Thing] | None:
    """Return the thing that a name ends in, with the word that says so; None for unknown things and for toys.

    The last word counts: a coffee mug is a mug, a table fork a fork, and a spoon rest is no spoon.
    """
    if any(is_word(word, small) for word in words for small in _SMALL):
        return None
    for word in reversed(words):
        if any(is_word(word, other) for other in _FOR_IT):
            return None
        for thing in THINGS:
            if any(is_word(word, name) for name in thing.words):
                return word, thing
    return None
