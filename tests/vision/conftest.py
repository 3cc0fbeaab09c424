"""What tests of sight share."""

from collections.abc import Iterator

import kept_renderers
import pytest


@pytest.fixture(scope="module", autouse=True)
def _renderers_end() -> Iterator[None]:
    yield
    kept_renderers.end_renderers()
