"""Every kernel compiles for graphics processors, on a machine without one.

The compilers of a toolkit are enough: ``nvidia-nvvm`` and ``nvidia-cuda-nvrtc``.
"""

import itertools
import platform
import re
import sys
from types import SimpleNamespace

import numba
import numpy as np
import pytest
import torch
from known_corner import known_corner

import objectfolder
from objectfolder.batch import (
    Batch,
    SightBatch,
    elastic_bodies,
    known_bodies,
    shear_bodies,
    sight_bodies,
    targets,
)  # fmt: skip
from objectfolder.batch.elastic_bodies import membrane_body
from objectfolder.batch.pixels import pixel_body

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        (sys.platform, platform.machine()) != ("linux", "x86_64"),
        reason="the lock has compilers for cards on Linux and x86-64 alone",
    ),
]
TOUCH = {
    "locate", "find", "stand", "advance", "penetrate", "fit", "count", "project", "pixel", "lean",
    "gap", "exceed", "descend", "compare", "deform", "membrane", "balance", "restrain", "dot", "aim",
    "follow", "darken",
}  # fmt: skip
SIGHT = {
    "cast", "light", "bend", "inputs", "mirror", "reflect", "colour", "send", "spread", "substance",
    "radiate", "scatter", "gather", "blend", "uneven", "cover",
}  # fmt: skip
NAMES = {"single": TOUCH, "double": TOUCH, "sight": SIGHT}
CARDS = [(8, 0), (9, 0), (12, 0)]
# Bodies whose arrays are all in single precision, and how much arithmetic of theirs there is at least.
IN_SINGLE = {
    pixel_body(False, np.float32): 20,
    membrane_body(False): 20,
    elastic_bodies.gap: 20,
    elastic_bodies.compare: 20,
}
FEW_STEPS = {
    elastic_bodies.exceed: 10,
    elastic_bodies.descend: 5,
    elastic_bodies.deform: 5,
    shear_bodies.balance: 20,
    shear_bodies.restrain: 10,
    shear_bodies.dot: 5,
    known_bodies.gather: 5,
    sight_bodies.blend: 20,
    sight_bodies.cover: 10,
}
SINGLE_CASES = [*itertools.product(IN_SINGLE, CARDS), *itertools.product(FEW_STEPS, CARDS[1:2])]


@pytest.fixture(scope="module")
def kernels():
    """All bodies and the types of their arguments, by precisions of touch; nothing is computed."""
    met = {kind: {} for kind in NAMES}

    def record(body, count, *arguments):
        types = [numba.typeof(part.numpy() if hasattr(part, "numpy") else part) for part in arguments]
        met[kind].setdefault(body, tuple(types))
        for part in arguments[-4:]:  # counts of none, views and faces of number 0
            if isinstance(part, torch.Tensor):
                part.zero_()

    patch = pytest.MonkeyPatch()
    patch.setattr(targets.Body, "__call__", record)
    bell = objectfolder.example("bell")  # its network has mirrors
    for kind in ("single", "double"):
        touch = Batch([bell], "cpu", precision=kind).touch
        touch.press(0, np.zeros((1, 3)))
        pressed = touch.press(0, np.zeros((1, 3)), force_n=1.0, steps=2, across_n=0.0, torque_nm=0.0)
        pressed.shear.markers.drawn_on(pressed.rgb)
        touch.penetrations(0, np.eye(4)[None])
    kind = "sight"
    cameras, lights = bell.sample_views(1)
    for sight in bell.sight, known_corner():
        SightBatch([sight], "cpu").render(0, cameras, lights, 4)
    # Views of which nothing is computed have no outlines.
    rgba, shown = torch.zeros((1, 4)), torch.zeros((1, 3))
    sight_bodies.cover(1, torch.zeros(1, dtype=torch.int64), rgba[0, :1], rgba, shown)
    patch.undo()
    return met


def ptx(monkeypatch, body, types, card, optimised):
    cuda = targets.cuda_module()
    for module in (cuda.dispatcher, cuda.compiler):
        device = SimpleNamespace(compute_capability=card)
        monkeypatch.setattr(module, "get_current_device", lambda device=device: device, raising=False)
    signature = numba.void(*[numba.int64] * 3, *types)
    return cuda.compile_ptx(body.plain, signature, cc=card, opt=optimised)[0]


@pytest.mark.release("objectfolder.batch", "objectfolder.touch", "objectfolder.vision")
@pytest.mark.parametrize("kind", NAMES)
def test_all_kernels_compile_for_a_card_that_is_not_there(kernels, monkeypatch, kind):
    assert {body.name for body in kernels[kind]} == NAMES[kind]
    once = kernels["single"].items() if kind == "double" else set()
    for body, types in kernels[kind].items() - once:
        assert ".target sm_90" in ptx(monkeypatch, body, types, (9, 0), False), body.name


@pytest.mark.parametrize(
    ("body", "card"), SINGLE_CASES, ids=[f"{body.name}-{card[0]}" for body, card in SINGLE_CASES]
)
def test_bodies_in_single_precision_compute_nothing_in_double(kernels, monkeypatch, body, card):
    types = {**kernels["sight"], **kernels["double"], **kernels["single"]}[body]
    code = ptx(monkeypatch, body, types, card, True)
    assert not re.findall(r"^.*\.f64.*$", code, re.MULTILINE)
    assert len(re.findall(r"\bfma\.rn\.f32|\bmul\.f32|\badd\.f32", code)) > {**IN_SINGLE, **FEW_STEPS}[body]
