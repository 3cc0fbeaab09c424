"""The browser, and small players, for all tests of pages of one object."""

from collections.abc import Iterator

import pytest

from pipeline.publish.viewer import bake
from tests.browser import browser, open_page, tabs

__all__ = ["browser", "open_page", "tabs"]


@pytest.fixture(scope="module")
def few_colours() -> Iterator[None]:
    """A tenth of the colours of a player: a network is asked for each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bake, "MOST_COLOURS", bake.MOST_COLOURS // 10)
        yield
