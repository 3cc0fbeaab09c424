"""Shared fixtures."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

# The real stages over toy bodies, and the S3 server, are modules of the pipeline's tests.
sys.path.append(str(Path(__file__).parents[1] / "pipeline"))


@pytest.fixture(scope="session", autouse=True)
def _dvc_keeps_to_itself(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What DVC knows of files of repositories of tests goes with them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DVC_SITE_CACHE_DIR", str(tmp_path_factory.mktemp("dvc")))
        patch.setenv("DVC_NO_ANALYTICS", "1")
        yield
