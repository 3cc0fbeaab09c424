"""Who does not hold the certificate is not spoken to; nobody but the owner may use it."""

import asyncio
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from processes import make_certificate

from objectfolder.errors import InputError
from pipeline.cluster import tls
from pipeline.cluster.places import Place


@pytest.fixture
def certificate(tmp_path, monkeypatch):
    monkeypatch.delenv("OBJECTFOLDER_TLS", raising=False)
    return make_certificate(tmp_path / "tls.pem")


def test_a_place_gets_a_certificate_of_its_own_or_the_file_that_all_have(certificate, tmp_path, monkeypatch):
    (first, second) = (tls.security(Place(), tmp_path) for _ in range(2))
    assert first.tls_client_key.startswith("-----BEGIN")
    assert first.tls_client_key != second.tls_client_key
    loaded = x509.load_pem_x509_certificate(first.tls_worker_cert.encode())
    now, decade = datetime.now(tz=UTC), timedelta(days=3650)  # clocks of hosts differ, and jump
    assert loaded.not_valid_before_utc < now - decade < now + decade < loaded.not_valid_after_utc
    assert tls.security(Place(tls=False), tmp_path) is None
    assert tls.security(Place(address="tcp://a:1"), tmp_path) is None
    assert tls.security(Place(tls="tls.pem"), tmp_path).tls_worker_key == str(certificate)
    with pytest.raises(InputError, match=r"share no certificate.*openssl req"):
        tls.security(Place(address="tls://a:1"), tmp_path)
    monkeypatch.setenv("OBJECTFOLDER_TLS", str(certificate))
    assert tls.security(Place(address="tls://a:1"), tmp_path).tls_ca_file == str(certificate)


def test_a_certificate_that_is_missing_or_open_to_others_is_refused(certificate):
    with pytest.raises(InputError, match=r"none\.pem: is missing.*openssl req"):
        tls.security_of_file(certificate.with_name("none.pem"))
    certificate.chmod(0o640)
    with pytest.raises(InputError, match=r"may be used by others.*chmod 600"):
        tls.security_of_file(certificate)


@pytest.mark.slow
def test_only_holders_of_the_certificate_are_spoken_to(certificate, tmp_path):
    stranger = make_certificate(tmp_path / "stranger.pem")
    outcome = asyncio.run(_attempts(certificate, stranger))
    assert outcome.pop("ours") == "identity"
    # The other side closes, or its certificate is not trusted: nobody of them gets an answer.
    assert outcome == {"another authority": "refused", "no certificate": "refused", "plain": "refused"}


async def _attempts(own, stranger):
    import ssl

    from distributed import Scheduler, Security
    from distributed.comm import connect

    security = tls.security_of_file(own)
    trusting = ssl.create_default_context(cafile=own)
    trusting.check_hostname = False
    who = {
        "ours": ("tls", security.get_connection_args("client")),
        "another authority": ("tls", tls.security_of_file(stranger).get_connection_args("client")),
        "no certificate": ("tls", {"ssl_context": trusting, "require_encryption": True}),
        "plain": ("tcp", Security(require_encryption=False).get_connection_args("client")),
    }
    answers = {}
    async with Scheduler(
        host="127.0.0.1", port=0, protocol="tls", security=security, dashboard_address="127.0.0.1:0"
    ) as scheduler:
        for name, (protocol, arguments) in who.items():
            address = f"{protocol}://{scheduler.address.partition('://')[2]}"
            seconds = 60 if name == "ours" else 5  # who is refused may never be answered
            try:
                comm = await connect(address, timeout=seconds, **arguments)
                await comm.write({"op": "identity", "reply": True})
                answer = await asyncio.wait_for(comm.read(), seconds)
                answers[name] = "identity" if answer["type"] == "Scheduler" else "another answer"
            except (OSError, TimeoutError):
                answers[name] = "refused"
    return answers


def test_listening_openly_is_said_so(capsys):
    for address in ("tcp://127.0.0.1:8786", "tcp://localhost:1", "tcp://[::1]:8786", "tls://10.0.0.1:8786"):
        tls.warn_if_open(address)
    assert capsys.readouterr().err == ""
    for address in ("tcp://10.0.0.1:8786", "tcp://0.0.0.0:1", "tcp://head:8786"):
        tls.warn_if_open(address)
        assert f"{address} is reached from other machines without TLS" in capsys.readouterr().err
