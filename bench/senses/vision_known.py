"""Sight of a known material against Cycles: what `bench.senses.vision --material known` records."""

from functools import partial

from bench.senses.vision_outcome import draw as draw_outcome

draw = partial(draw_outcome, name="vision_known")
