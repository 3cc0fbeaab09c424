import importlib
import os
import re
import subprocess
import sys
import types
from pathlib import Path

import pytest
from llvmlite.binding import get_host_cpu_features

import objectfolder
from objectfolder.jit import _Compiling, kernel

PROGRAM = """
import numpy as np
from numba.core.registry import cpu_target
from objectfolder.touch.contact.height_field import _lowest
from objectfolder.vision.compiled.network import _softplus
_softplus(np.float32(1.0))
_lowest(np.zeros((1, 3, 3)), np.arange(2.0), np.arange(2.0), 0.0)
print(cpu_target.target_context.codegen().magic_tuple()[1])
"""


FIRST_QUERY = """
import objectfolder
mug = objectfolder.example("mug")
points, _ = mug.sample_contacts(1, seed=0, reachable=False)
from numba.core import event
compiled = []
class Listener(event.Listener):
    def on_start(self, event):
        function = event.data["dispatcher"].py_func
        compiled.append((function.__module__ or "") + "." + function.__name__)
    def on_end(self, event):
        pass
event.register("numba:compile", Listener())
{}
print(*compiled)
"""


def compiled_in_a_new_process(tmp_path, program: str = PROGRAM, **environment: str) -> tuple[str, str]:
    plain = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True,
        env={**plain, "NUMBA_CACHE_DIR": str(tmp_path), **environment},
    )  # fmt: skip
    return done.stdout.strip(), done.stderr


@pytest.mark.slow
def test_compiling_is_said_once_and_loading_from_the_cache_is_not(tmp_path):
    assert compiled_in_a_new_process(tmp_path)[1].count("compiling kernels") == 1
    assert compiled_in_a_new_process(tmp_path)[1] == ""


def test_compiling_is_logged_once_and_without_a_cache_with_the_remedy(caplog, monkeypatch):
    function = types.SimpleNamespace(py_func=kernel)  # any of this package
    compilation = types.SimpleNamespace(data={"dispatcher": function})
    listener = _Compiling()
    for _ in range(2):
        listener.on_start(compilation)
        listener.on_end(compilation)
    monkeypatch.setattr(_Compiling, "cached", False)
    uncached = _Compiling()
    uncached.on_start(compilation)
    uncached.on_end(compilation)
    once, each_time = caplog.records
    assert "once for this installation" in once.getMessage()
    assert "Set NUMBA_CACHE_DIR" in each_time.getMessage()


@pytest.mark.slow
def test_where_no_cache_can_be_written_the_remedy_is_shown(tmp_path):
    locators = {"NUMBA_CACHE_LOCATOR_CLASSES": "IPythonCacheLocator"}  # finds no folder for a module
    assert "Set NUMBA_CACHE_DIR" in compiled_in_a_new_process(tmp_path, **locators)[1]


@pytest.mark.slow
@pytest.mark.skipif(not get_host_cpu_features().get("avx2", False), reason="a processor without AVX2")
def test_every_process_compiles_for_one_target_unless_told_another(tmp_path):
    assert compiled_in_a_new_process(tmp_path)[0] == "haswell"
    assert compiled_in_a_new_process(tmp_path, NUMBA_CPU_NAME="generic")[0] == "generic"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("query", "most"),
    [("mug.render(*mug.sample_views(1, seed=0), resolution=64)", 50), ("mug.press(points)", 60)],
    ids=["sight", "touch"],
)
def test_a_first_query_compiles_few_functions_and_each_kernel_for_one_signature(tmp_path, query, most):
    compiled = compiled_in_a_new_process(tmp_path, FIRST_QUERY.format(query))[0].split()
    own = [name for name in compiled if name.startswith("objectfolder.")]
    assert len(own) == len(set(own)) > 20
    assert len(compiled) <= most


def test_kernels_take_nothing_from_other_files():
    # numba's cache looks at the date of a kernel's own file: what it took from another would go stale.
    root, found = Path(objectfolder.__file__).parent, 0
    for path in sorted(root.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if "from objectfolder.jit import" not in source:
            continue
        module = importlib.import_module(".".join(path.relative_to(root.parent).with_suffix("").parts))
        for name, value in vars(module).items():
            if not hasattr(value, "py_func") or value.py_func.__module__ != module.__name__:
                continue
            found += 1
            for used in value.py_func.__code__.co_names:
                taken = vars(module).get(used)
                if taken is None or isinstance(taken, types.ModuleType):
                    continue
                home = taken.py_func.__module__ if hasattr(taken, "py_func") else None
                own = home == module.__name__ or re.search(rf"^(\w+, )*{used}\b.* = ", source, re.MULTILINE)
                assert own, f"{module.__name__}.{name} takes {used}"
    assert found > 45
