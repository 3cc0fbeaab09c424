"""Fixtures of the pipeline's tests."""

import os
from pathlib import Path

import pytest
from toys import Toys


@pytest.fixture
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Toys:
    package = f"toys_{abs(hash(str(tmp_path)))}"
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    data_set = Toys(tmp_path, package)
    for object_id, content in (("ball", "1.0"), ("cup", "2.0"), ("dish", "3.0")):
        data_set.add(object_id, content)
    return data_set
