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

PROGRAM = """
import numpy as np
from numba.core.registry import cpu_target
from objectfolder.vision.compiled.borders import contrasting, sum_by_pixel
sum_by_pixel(np.zeros(2, np.int32), np.ones(2, np.float32), np.ones((2, 3), np.float32), 1)
contrasting(np.zeros((1, 1), np.int32), np.zeros((1, 3)), 0.5)
print(cpu_target.target_context.codegen().magic_tuple()[1])
"""


def compiled_in_a_new_process(tmp_path, **environment: str) -> tuple[str, str]:
    plain = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True,
        env={**plain, "NUMBA_CACHE_DIR": str(tmp_path), **environment},
    )  # fmt: skip
    return done.stdout.strip(), done.stderr


@pytest.mark.slow
def test_compiling_is_said_once_and_loading_from_the_cache_is_not(tmp_path):
    assert compiled_in_a_new_process(tmp_path)[1].count("compiling kernels") == 1
    assert compiled_in_a_new_process(tmp_path)[1] == ""


@pytest.mark.slow
@pytest.mark.skipif(not get_host_cpu_features().get("avx2", False), reason="a processor without AVX2")
def test_every_process_compiles_for_one_target_unless_told_another(tmp_path):
    assert compiled_in_a_new_process(tmp_path)[0] == "haswell"
    assert compiled_in_a_new_process(tmp_path, NUMBA_CPU_NAME="generic")[0] == "generic"


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
