"""A named pipe, a socket or a device in place of a file: no reader waits, all say what it is."""

import os
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from objectfolder.dataset.reading import ProductReader
from objectfolder.errors import ObjectFolderError
from objectfolder.making.materials import read_materials
from objectfolder.making.mesh.readers.files import read_bytes
from objectfolder.making.recordings.recording import read_recording
from objectfolder.products.provenance import file_digest
from objectfolder.products.regular_file import open_regular, read_regular
from objectfolder.products.store import read_attributes, read_product
from objectfolder.products.tensor_file import read_metadata, read_tensor_file
from pipeline.dataset import archives
from pipeline.dataset.manifest import PRODUCTS, read_products
from pipeline.dataset.products import md5_of
from pipeline.dataset.records import RECORDS, read_records
from pipeline.dataset.validation import read_yaml
from pipeline.store.storage import copy_file

LONGEST_S = 20
READERS = (
    archives.check, archives.read_attributes, file_digest, md5_of, ProductReader, read_attributes, read_bytes,
    read_materials, read_metadata, read_product, read_recording, read_tensor_file, read_yaml,
    lambda path: copy_file(path, path.with_name("copy")),
)  # fmt: skip


@pytest.fixture(autouse=True)
def _no_wait() -> Iterator[None]:
    """End a read that waits."""

    def end(number: int, frame: object) -> None:
        raise TimeoutError("it waits for a writer")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(LONGEST_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)
def test_no_reader_waits_at_a_named_pipe(tmp_path, read):
    os.mkfifo(tmp_path / "file")
    with pytest.raises((OSError, ObjectFolderError), match="is a named pipe, not a file"):
        read(tmp_path / "file")


@pytest.mark.parametrize(("read", "name"), [(read_records, RECORDS), (read_products, PRODUCTS)])
def test_nor_does_a_reader_of_a_data_set(tmp_path, read, name):
    (tmp_path / "data").mkdir()
    os.mkfifo(tmp_path / name)
    with pytest.raises(ObjectFolderError, match=f"{Path(name).name}.*is a named pipe, not a file"):
        read(tmp_path)


def test_other_kinds_are_named_and_links_followed(tmp_path):
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(tmp_path / "socket"))
    (tmp_path / "device").symlink_to("/dev/zero")
    (tmp_path / "folder").mkdir()
    for name in ("socket", "device", "folder"):
        with pytest.raises(OSError, match=f"is a {name}, not a file"):
            open_regular(tmp_path / name)
    listener.close()
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "link").symlink_to("file")
    assert read_regular(tmp_path / "link") == b"content"
