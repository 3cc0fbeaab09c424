"""An S3 API server on this machine, and what clients need to find it.

``python s3_server.py HOST PORT`` serves until it is ended, for tests of several hosts. A server of another
make can take the place of moto's: ``OBJECTFOLDER_TEST_S3=http://127.0.0.1:PORT``.
"""

import contextlib
import functools
import logging
import os
import sys
import threading
import uuid
from collections.abc import Iterator

import pytest

OTHER = "OBJECTFOLDER_TEST_S3"
CREDENTIALS = {
    "AWS_ACCESS_KEY_ID": "S3RVER",
    "AWS_SECRET_ACCESS_KEY": "S3RVER",
    "AWS_REGION": "us-east-1",
    "AWS_DEFAULT_REGION": "us-east-1",
    "AWS_CONFIG_FILE": "/nonexistent/config",
    "AWS_SHARED_CREDENTIALS_FILE": "/nonexistent/credentials",
    "AWS_EC2_METADATA_DISABLED": "true",
}


def environment(address: str) -> dict[str, str]:
    """Variables by which libraries find the server at `address`."""
    return {**CREDENTIALS, "AWS_ENDPOINT_URL": address}


@contextlib.contextmanager
def serving() -> Iterator[str]:
    """Yield the address of a server."""
    if server_address := os.environ.get(OTHER):
        yield server_address
        return
    pytest.importorskip("flask_cors", reason="moto's server is not installed")
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = pytest.importorskip("moto.server").ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    try:
        yield f"http://{host}:{port}"
    finally:
        server.stop()


@functools.cache
def client(address: str):
    """A plain client of another library than the one under test."""
    boto3 = pytest.importorskip("boto3")
    return boto3.client(
        "s3", endpoint_url=address, region_name="us-east-1", aws_access_key_id="S3RVER",
        aws_secret_access_key="S3RVER",
    )  # fmt: skip


def new_bucket(address: str) -> str:
    """Name of a bucket made for one test."""
    name = f"bucket-{uuid.uuid4().hex[:12]}"
    client(address).create_bucket(Bucket=name)
    return name


def contents(address: str, bucket: str) -> dict[str, bytes]:
    """All objects of a bucket, read past any proxy."""
    connection = client(address)
    pages = connection.get_paginator("list_objects_v2").paginate(Bucket=bucket)
    keys = [entry["Key"] for page in pages for entry in page.get("Contents", [])]
    return {key: connection.get_object(Bucket=bucket, Key=key)["Body"].read() for key in keys}


if __name__ == "__main__":
    from moto.server import ThreadedMotoServer

    ThreadedMotoServer(sys.argv[1], int(sys.argv[2]), verbose=False).start()
    threading.Event().wait()
