"""Fixtures of the tests of sources."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.sources.file_server import FileServer
from tests.sources.served_file import CONTENT


@pytest.fixture
def file_server(tmp_path: Path) -> FileServer:
    """A server of a folder with one file, ``a.bin``."""
    folder = tmp_path / "served"
    folder.mkdir()
    (folder / "a.bin").write_bytes(CONTENT)
    os.utime(folder / "a.bin", (1e9, 1e9))
    return FileServer(folder)


@pytest.fixture
def address(file_server: FileServer) -> Iterator[str]:
    """Where it listens."""
    with file_server.listening() as listening:
        yield listening


@pytest.fixture
def cache_folder(tmp_path: Path) -> Path:
    return tmp_path / "cache"
