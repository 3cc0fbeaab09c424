"""Shared fixtures."""

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def shared_objects() -> Path:
    """Folder of real scanned objects with its catalogue; tests that need it skip where it is absent."""
    folder = Path(os.environ.get("OBJECTFOLDER_SCANS", REPOSITORY.parent / "shared" / "objects"))
    if not (folder / "catalogue.csv").is_file():
        pytest.skip(f"no scanned objects at {folder}; set OBJECTFOLDER_SCANS to a folder with catalogue.csv")
    return folder
