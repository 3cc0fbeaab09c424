import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from llvmlite.binding import get_host_cpu_features
from numba import njit
from numba import types as numba_types
from numba.core import event

import objectfolder
from objectfolder.jit import inner, kernel
from objectfolder.products.provenance import file_digest, package_versions

PROGRAM = """
import objectfolder
mug = objectfolder.example("mug")
points, _ = mug.sample_contacts(1, seed=0, reachable=False)
from numba.core import event
from numba.core.registry import cpu_target
compiled, inner, nested = [], set(), []
class Listener(event.Listener):
    def on_start(self, event):
        function = event.data["dispatcher"].py_func
        compiled.append((function.__module__ or "") + "." + function.__name__)
        inner.update(compiled[-1:] if nested else [])
        nested.append(function)
    def on_end(self, event):
        nested.pop()
event.register("numba:compile", Listener())
{}
print(cpu_target.target_context.codegen().magic_tuple()[1], *compiled)
"""
UNCACHED = """
import numpy as np
from objectfolder.vision.compiled.network_kernels import _softplus
_softplus(np.float32(1.0))
"""
# What is asked first, and the least and the most own functions that it may compile.
QUERIES = {
    "a kernel": (UNCACHED, 1, 2),
    "sight": ("mug.render(*mug.sample_views(1, seed=0), resolution=64)", 21, 50),
    "touch": ("mug.press(points)", 21, 52),
}
# Kernels that first queries of both senses call, with the number of their signatures. Where none is cached,
# those that another kernel calls are compiled beside it.
CALLED = """
import sys
called = {
    f"{name}.{kernel}": len(value.signatures)
    for name, module in sys.modules.items() if name.startswith("objectfolder.")
    for kernel, value in vars(module).items()
    if hasattr(value, "py_func") and value.signatures and value.py_func.__module__ == name
}
print(*called.keys() - inner, sep="\\n")
assert set(called.values()) == {1}, called
"""
MOST_CALLED = 24
Answers = list[tuple[list[str], str]]


@inner(kernel)
def _inner_sum(x):
    return x + 0.5


@kernel
def _outer_sum(x):
    return 2.0 * _inner_sum(x)


def answer_of_a_new_process(cache: Path, query: str, **environment: str) -> tuple[list[str], str]:
    """What it compiled for, the names of what it compiled, and what it wrote on standard error."""
    plain = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(query)], capture_output=True, text=True, check=True,
        env={**plain, "NUMBA_CACHE_DIR": str(cache), **environment},
    )  # fmt: skip
    return done.stdout.split(), done.stderr


def kernel_key() -> dict[str, Any]:
    """What decides which kernels are compiled: all code, and numba."""
    package = Path(objectfolder.__file__).parent
    code = {str(path): file_digest(path) for path in [Path(__file__), *sorted(package.rglob("*.py"))]}
    return {"code": code, "packages": package_versions(("llvmlite", "numba", "numpy"))}


@pytest.fixture(
    scope="module",
    params=[
        "a kernel",
        *(pytest.param(name, marks=pytest.mark.release(f"objectfolder.{package}"))
          for name, package in (("sight", "vision"), ("touch", "touch"))),
    ],
)  # fmt: skip
def answers(request: pytest.FixtureRequest, make_once: Callable[..., Path]) -> tuple[Answers, range]:
    """Of two processes with one query, the first with an empty cache; and how much the first may compile."""
    query, least, most = QUERIES[request.param]

    def ask(folder: Path) -> None:
        both = [answer_of_a_new_process(folder / "cache", query) for _ in range(2)]
        shutil.rmtree(folder / "cache")
        (folder / "answers.json").write_text(json.dumps(both))

    folder = make_once(f"first-query-{request.param}", ask, kernel_key())
    return json.loads((folder / "answers.json").read_text()), range(least, most + 1)


@pytest.mark.slow
def test_compiling_is_said_once_and_loading_from_the_cache_is_not(answers):
    first, second = answers[0]
    assert first[1].count("compiling kernels") == first[1].count("once for this installation") == 1
    assert second[1] == ""
    assert second[0][1:] == []


@pytest.mark.slow
def test_a_first_query_compiles_few_functions_and_each_kernel_for_one_signature(answers):
    (first, _), allowed = answers
    own = [name for name in first[0] if name.startswith("objectfolder.")]
    assert len(own) == len(set(own)) >= allowed.start
    assert len(own) in allowed


@pytest.mark.slow
def test_first_queries_call_few_kernels_each_with_one_signature(make_once):
    program = PROGRAM.format("\n".join([QUERIES["sight"][0], QUERIES["touch"][0], CALLED]))

    def ask(folder: Path) -> None:
        # Again where some were compiled: a kernel whose parts alone are cached would load these beside it.
        for _ in range(2):
            done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
            *called, target_and_compiled = done.stdout.splitlines()
            if len(target_and_compiled.split()) == 1:
                break
        (folder / "called").write_text("\n".join(called))

    kernels = (make_once("called-kernels", ask, kernel_key()) / "called").read_text().splitlines()
    assert 20 < len(kernels) <= MOST_CALLED


@pytest.mark.slow
@pytest.mark.skipif(not get_host_cpu_features().get("avx2", False), reason="a processor without AVX2")
def test_every_process_compiles_for_one_target(answers):
    assert {target for (target, *_), _ in answers[0]} == {"haswell"}


@pytest.mark.slow
def test_another_target_and_where_no_cache_can_be_written_the_remedy(tmp_path):
    # IPython's locator finds no folder for a module.
    environment = {"NUMBA_CACHE_LOCATOR_CLASSES": "IPythonCacheLocator", "NUMBA_CPU_NAME": "generic"}
    (target, *_), errors = answer_of_a_new_process(tmp_path, UNCACHED, **environment)
    assert target == "generic"
    assert "Set NUMBA_CACHE_DIR" in errors


def test_an_inner_kernel_serves_kernels_and_refuses_python():
    assert _outer_sum(2.0) == 5.0
    with pytest.raises(TypeError, match="_inner_sum is called by kernels alone"):
        _inner_sum(2.0)


def test_numba_resolves_calls_of_others_as_ever():
    compiled = []

    @njit
    def double(x):
        return x * 2.0

    class Listener(event.Listener):
        def on_start(self, event):
            compiled.append((event.data["dispatcher"], vars(numba_types.Function).get("get_call_type")))

        on_end = on_start

    with event.install_listener("numba:compile", Listener()):
        assert double(1) + _outer_sum(1) == 5.0
    assert "get_call_type" not in vars(numba_types.Function)
    assert {patched is None for dispatcher, patched in compiled if dispatcher is double} == {True}


def test_kernels_take_nothing_from_other_files():
    # numba's cache looks at the date of a kernel's own file: what it took from another would go stale.
    root, count = Path(objectfolder.__file__).parent, 0
    for path in sorted(root.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if "from objectfolder.jit import" not in source:
            continue
        module = importlib.import_module(".".join(path.relative_to(root.parent).with_suffix("").parts))
        for name, value in vars(module).items():
            if not hasattr(value, "py_func") or value.py_func.__module__ != module.__name__:
                continue
            count += 1
            for used in value.py_func.__code__.co_names:
                referent = vars(module).get(used)
                if referent is None or isinstance(referent, types.ModuleType):
                    continue
                home = referent.py_func.__module__ if hasattr(referent, "py_func") else None
                own = home == module.__name__ or re.search(rf"^(\w+, )*{used}\b.* = ", source, re.MULTILINE)
                assert own, f"{module.__name__}.{name} takes {used}"
    assert count > 45
