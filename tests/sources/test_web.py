"""Servers are asked politely, where they are told to be, and what they say is told apart."""

import json
import ssl
import time
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler
from ipaddress import IPv4Address
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from objectfolder.errors import FormatError, InputError
from pipeline.intake.sources import download, http_client
from pipeline.intake.sources.download import Downloader
from tests.pipeline.http_faults import serving
from tests.sources.file_server import FileServer, scripted
from tests.sources.served_file import AMPLE, CONTENT, SHORT


@pytest.mark.parametrize("kind", ["403", "404", "loop"])
def test_what_does_not_pass_is_told_at_once(file_server, address, cache_folder, kind):
    file_server.plan = scripted(kind)
    with pytest.raises(InputError) as refused:
        Downloader(cache_folder, **AMPLE).file(f"{address}/a.bin")
    assert refused.value.remedy
    assert type(refused.value) is {"403": http_client.RefusedError, "404": http_client.AbsentError}.get(
        kind, InputError
    )
    assert len(file_server.requests) <= http_client.MOST_REDIRECTS + 1


def test_a_server_that_asks_for_time_gets_it(file_server, address, cache_folder):
    file_server.plan, file_server.retry_after = scripted("429"), "1"
    began = time.monotonic()
    assert Downloader(cache_folder, **AMPLE).file(f"{address}/a.bin").read_bytes() == CONTENT
    assert time.monotonic() - began >= 1


@pytest.mark.parametrize(("retry_after", "finding"), [("3600", "longer wait"), ("0", "429")])
def test_a_server_that_asks_for_too_much_time_is_given_up(
    file_server, address, cache_folder, retry_after, finding
):
    file_server.plan, file_server.retry_after = scripted(*["429"] * 1000), retry_after
    with pytest.raises(http_client.UnreachableError, match=finding) as refused:
        Downloader(cache_folder, **SHORT).file(f"{address}/a.bin")
    assert "later" in refused.value.remedy
    assert len(file_server.requests) == (1 if retry_after == "3600" else 2)


def test_nobody_there(cache_folder):
    with pytest.raises(InputError, match="refuses connections") as refused:
        Downloader(cache_folder, **SHORT).file("http://127.0.0.1:1/a")
    assert refused.value.remedy


@pytest.mark.parametrize("url", ["ftp://host/a", "/etc/passwd", "http://["])
def test_only_addresses_of_the_web(url, cache_folder):
    with pytest.raises(InputError) as refused:
        Downloader(cache_folder, **SHORT).file(url)
    assert refused.value.remedy


@pytest.mark.parametrize("target", ["file:///etc/passwd", "http://["])
def test_redirections_stay_in_the_web(file_server, address, cache_folder, target, monkeypatch):
    monkeypatch.setattr("tests.sources.file_server.redirection", lambda path, kind: target)
    file_server.plan = scripted("moved")
    with pytest.raises(InputError, match="cannot be asked"):
        Downloader(cache_folder, **SHORT).file(f"{address}/a.bin")


def test_a_file_has_a_deadline(file_server, address, cache_folder, monkeypatch):
    monkeypatch.setattr(download, "LONGEST_S", 0.0)
    with pytest.raises(InputError, match="not there after 0 hours"):
        Downloader(cache_folder, **SHORT).file(f"{address}/a.bin")


@pytest.fixture
def certificate(tmp_path) -> Path:
    """Of a server at 127.0.0.1, and its key, in one file."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "127.0.0.1")])
    now = datetime.now(UTC)
    x509_certificate = (
        x509.CertificateBuilder(
            name, name, key.public_key(), x509.random_serial_number(), now, now + timedelta(1)
        )
        .add_extension(
            x509.SubjectAlternativeName([x509.IPAddress(IPv4Address("127.0.0.1"))]), critical=False
        )
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    path = tmp_path / "certificate.pem"
    plain = (serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    pem = serialization.Encoding.PEM
    path.write_bytes(x509_certificate.public_bytes(pem) + key.private_bytes(pem, *plain))
    return path


def test_certificates_are_checked_and_redirections_do_not_leave_tls(
    file_server, certificate, cache_folder, monkeypatch
):
    file_server.tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    file_server.tls.load_cert_chain(certificate)
    with file_server.listening() as address:
        assert address.startswith("https:")
        with pytest.raises(InputError, match="certificate cannot be verified") as refused:
            Downloader(cache_folder, **AMPLE).file(f"{address}/a.bin")
        assert "REQUESTS_CA_BUNDLE" in refused.value.remedy
        assert not file_server.requests
        monkeypatch.setenv("REQUESTS_CA_BUNDLE", str(certificate))
        assert Downloader(cache_folder, **AMPLE).file(f"{address}/a.bin").read_bytes() == CONTENT
        plain = FileServer(file_server.folder)
        with plain.listening() as open_address:
            monkeypatch.setattr(
                "tests.sources.file_server.redirection", lambda path, kind: f"{open_address}/a.bin"
            )
            file_server.plan = scripted("moved")
            with pytest.raises(InputError, match="redirected from https to http"):
                Downloader(cache_folder / "2", **AMPLE).file(f"{address}/a.bin")


def test_mirrors_stand_in(file_server, address, cache_folder):
    file_server.documents = {"/near/a": b"near", "/far/b": b"far"}
    mirrors = {
        "https://source.invalid/": f"{address}/far/",
        "https://source.invalid/models/": f"{address}/near/",
    }
    downloader = Downloader(cache_folder, mirrors=mirrors, **AMPLE)
    assert downloader.file("https://source.invalid/models/a").read_bytes() == b"near"
    assert downloader.file("https://source.invalid/b").read_bytes() == b"far"


def test_proxies_by_option_and_by_environment(file_server, address, cache_folder, monkeypatch):
    url = "http://source.invalid/a.bin"
    assert Downloader(cache_folder, proxies={"http": address}, **AMPLE).file(url).read_bytes() == CONTENT
    assert file_server.requests[0][1] == url
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:1")
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:1")
    assert (
        Downloader(cache_folder / "2", proxies={"http": address}, **AMPLE).file(url).read_bytes() == CONTENT
    )
    with pytest.raises(InputError, match="proxy"):
        Downloader(cache_folder / "3", **SHORT).file(url)
    monkeypatch.setenv("http_proxy", address)
    assert Downloader(cache_folder / "3", **AMPLE).file(url).read_bytes() == CONTENT
    monkeypatch.setenv("no_proxy", "source.invalid")
    with pytest.raises(InputError, match="name is not known"):
        Downloader(cache_folder / "4", **SHORT).file(url)


def test_a_proxy_that_refuses_tunnels_is_told_at_once(cache_folder):
    class Refusing(BaseHTTPRequestHandler):
        def do_CONNECT(self) -> None:
            self.send_error(407)

        def log_message(self, *_: object) -> None:
            pass

    with serving(Refusing) as proxy:
        proxies = {"https": proxy.replace("//", "//name:secret@")}
        with pytest.raises(http_client.RefusedError, match=r"refused by its proxy \(407") as refused:
            Downloader(cache_folder, proxies=proxies, **AMPLE).file("https://source.invalid/a")
    assert "secret" not in str(refused.value)


def test_passwords_of_mirrors_are_neither_told_nor_kept(file_server, address, cache_folder):
    mirrors = {"https://source.invalid/": address.replace("//", "//name:secret@") + "/"}
    file_server.plan = scripted(*["short"] * 1000)
    with pytest.raises(InputError) as refused:
        Downloader(cache_folder, mirrors=mirrors, **SHORT).file("https://source.invalid/a.bin")
    file_server.plan = scripted()
    Downloader(cache_folder, mirrors=mirrors, **AMPLE).file("https://source.invalid/a.bin")
    assert file_server.requests[-1][2]["authorization"].startswith("Basic ")
    assert "secret" not in str(refused.value)
    assert not any(b"secret" in path.read_bytes() for path in cache_folder.rglob("*") if path.is_file())


def test_documents(file_server, address, cache_folder):
    said = {"name": "Käse", "deep": [1, 2.5, None]}
    file_server.documents = {
        "/files/x?page=2": json.dumps(said).encode(),
        "/page": b"<html>",
        "/deep": b"[" * 100_000,
    }
    downloader = Downloader(cache_folder, **AMPLE)
    file_server.plan = scripted("503", "cut", "reset")
    assert downloader.json(f"{address}/files/x?page=2") == said
    assert len(file_server.requests) == 4
    for path in ("/page", "/deep"):
        with pytest.raises(FormatError, match="not JSON"):
            downloader.json(address + path)
    with pytest.raises(http_client.AbsentError):
        downloader.json(f"{address}/files/x?page=3")
    with pytest.raises(InputError, match="larger than 10 bytes"):
        downloader.json(f"{address}/files/x?page=2", limit_bytes=10)
    assert not cache_folder.exists()
