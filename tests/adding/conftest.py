"""Shared fixtures."""

import pytest


@pytest.fixture(autouse=True)
def _small_views(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw the views of a picture with fewer rays; the picture itself is as large as ever."""
    monkeypatch.setattr("pipeline.intake.add.preview.PIXELS", 100)
