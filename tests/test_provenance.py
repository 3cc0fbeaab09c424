"""Fingerprints name causes: they move with what decides a number, and with nothing else."""

import hashlib
import json
import pickle
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from objectfolder.errors import InputError
from objectfolder.products.provenance import (
    Constant,
    canonical_json,
    code_identity,
    fingerprint,
    json_lines,
    package_versions,
    seed_from,
)

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text(), JSON, max_size=4))
def test_fingerprint_ignores_the_order_of_keys(parts):
    assert fingerprint(parts) == fingerprint(dict(reversed(parts.items())))
    assert fingerprint(parts) != fingerprint({**parts, "another": 1})


@given(st.dictionaries(st.text(), JSON, max_size=4), st.text())
def test_a_constant_part_counts_as_any_other(part, name):
    constant = Constant(part)
    parts = {name: part, f"{name}!": 1}
    expected = hashlib.sha256(canonical_json(parts).encode()).hexdigest()
    assert fingerprint(parts) == fingerprint({**parts, name: constant}) == expected
    copy = pickle.loads(pickle.dumps(constant))
    assert (type(copy), copy) == (dict, part)


def test_numbers_that_are_no_numbers_have_no_fingerprint():
    with pytest.raises(ValueError, match="not JSON compliant"):
        canonical_json({"x": float("nan")})


def test_seeds_differ_by_base_stage_and_object_and_fit_31_bits():
    seeds = {
        seed_from(base, task, name) for base in (0, 1) for task in ("views", "modes") for name in ("a", "b")
    }
    assert len(seeds) == 8
    assert all(0 <= seed < 2**31 for seed in seeds)
    assert seed_from(0, "views", "a") == seed_from(0, "views", "a")


def test_absent_packages_are_said_to_be():
    assert package_versions(["no-such-package", "numpy"])["no-such-package"] == "absent"


def test_unknown_module_is_named():
    with pytest.raises(InputError, match=r"objectfolder\.nothing"):
        code_identity("objectfolder.nothing")


@pytest.fixture
def package(tmp_path, monkeypatch):
    name = f"sample_{abs(hash(str(tmp_path)))}"
    folder = tmp_path / name
    (folder / "inner").mkdir(parents=True)
    monkeypatch.syspath_prepend(str(tmp_path))
    files = {
        "__init__.py": "VERSION = 1\n",
        "task.py": f"from {name}.inner import shape\nfrom .direct import size\n\n\n"
        "def body():\n    return size\n",
        "direct.py": "def size():\n    from .lazy import number\n\n    return number\n",
        "lazy.py": "number = 1\n",
        "inner/__init__.py": "LOOSE = 1\n",
        "inner/shape.py": "import numpy as np\n\nSHAPE = 'a string that counts'\n",
        "stranger.py": "x = 1\n",
    }
    for path, text in files.items():
        (folder / path).write_text(text)
    yield name, folder
    for module in [module for module in sys.modules if module.startswith(name)]:
        del sys.modules[module]


def test_code_is_followed_through_imports_of_every_form(package):
    name, _ = package
    identity = code_identity(f"{name}.task")
    assert list(identity) == [f"{name}.{part}" for part in ("direct", "inner.shape", "lazy", "task")]
    assert not any(module.startswith(name) for module in sys.modules)  # nothing was imported


@pytest.mark.parametrize(
    ("path", "old", "new", "changes"),
    [
        ("lazy.py", "number = 1", "number = 2", True),
        ("lazy.py", "number = 1", '"""Docstring."""\n\nnumber = 1  # why', False),
        ("lazy.py", "number = 1", "number   =   (1)", False),
        ("task.py", "def body():\n", 'def body():\n    """What it does."""\n', False),
        ("inner/shape.py", "a string that counts", "another", True),
        ("inner/__init__.py", "LOOSE = 1", "LOOSE = 2", False),
        ("__init__.py", "VERSION = 1", "VERSION = 2", False),
        ("stranger.py", "x = 1", "x = 2", False),
    ],
)
def test_code_identity_moves_with_code_alone(package, path, old, new, changes):
    name, folder = package
    before = code_identity(f"{name}.task")
    text = (folder / path).read_text()
    assert old in text
    (folder / path).write_text(text.replace(old, new))
    assert (code_identity(f"{name}.task") != before) == changes


def test_an_init_counts_where_a_name_is_taken_from_it(package):
    name, folder = package
    (folder / "lazy.py").write_text(f"from {name}.inner import LOOSE\n")
    assert f"{name}.inner" in code_identity(f"{name}.task")


def test_a_module_run_by_name_counts(package):
    name, folder = package
    (folder / "lazy.py").write_text(f"COMMAND = ['python', '-m', '{name}.stranger']\n")
    assert f"{name}.stranger" in code_identity(f"{name}.task")


def test_lines_of_json_are_those_of_the_standard_encoder():
    value = {
        "objects": {"mug": {"senses": ["sight", "é"], "wall": None}, "cup": {}},
        "refused": [],
        "n": [1.5],
    }
    assert json_lines(value, 9) == json.dumps(value, indent=1, ensure_ascii=False)
    for levels in range(4):
        assert json.loads(json_lines(value, levels)) == value
    mug = '  "mug": {"senses": ["sight", "é"], "wall": null},'
    assert mug in json_lines(value, 2).splitlines()
    with pytest.raises(ValueError, match="JSON compliant"):
        json_lines({"loss": float("nan")}, 1)
