"""Who holds no certificate of ours is not spoken to; nobody but the owner reads the keys."""

import asyncio
import stat

import pytest
from processes import job, run

from objectfolder.errors import InputError
from pipeline.cluster import tls
from pipeline.cluster.cluster import runner
from pipeline.cluster.places import Place


@pytest.fixture
def certificates(tmp_path):
    tls.make(tmp_path / "own")
    return tmp_path / "own"


def test_keys_are_for_their_owner_alone_and_made_once(certificates):
    assert sorted(path.name for path in certificates.iterdir()) == sorted(tls.FILES)
    assert {stat.S_IMODE(path.stat().st_mode) for path in certificates.iterdir()} == {0o600}
    assert stat.S_IMODE(certificates.stat().st_mode) == 0o700
    before = {path: path.read_bytes() for path in certificates.iterdir()}
    tls.make(certificates)
    assert {path: path.read_bytes() for path in certificates.iterdir()} == before
    assert b"PRIVATE" not in (certificates / tls.AUTHORITY).read_bytes()


def test_certificates_that_are_incomplete_are_not_mended_by_new_ones(certificates):
    (certificates / tls.KEY).unlink()
    with pytest.raises(InputError, match=r"key\.pem: is missing.*OBJECTFOLDER_TLS"):
        tls.make(certificates)
    with pytest.raises(InputError, match=r"authority\.pem: is missing"):
        tls.security(certificates.parent / "none")


def test_the_variable_names_the_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("OBJECTFOLDER_TLS", raising=False)
    assert tls.folder_of(tmp_path, wanted=False) is None
    assert tls.folder_of(tmp_path, wanted=True) == tmp_path / ".objectfolder" / "tls"
    monkeypatch.setenv("OBJECTFOLDER_TLS", "/somewhere")
    assert str(tls.folder_of(tmp_path, wanted=False)) == "/somewhere"


def test_only_holders_of_the_certificate_are_spoken_to(certificates, tmp_path):
    tls.make(tmp_path / "stranger")
    outcome = asyncio.run(_attempts(certificates, tmp_path / "stranger"))
    assert outcome.pop("ours") == "identity"
    # The other side closes, or its certificate is not trusted: nobody of them gets an answer.
    assert outcome == {"another authority": "refused", "no certificate": "refused", "plain": "refused"}


async def _attempts(own, stranger):
    import ssl

    from distributed import Scheduler, Security
    from distributed.comm import connect

    trusting = ssl.create_default_context(cafile=own / tls.AUTHORITY)
    trusting.check_hostname = False
    who = {
        "ours": ("tls", tls.security(own).get_connection_args("client")),
        "another authority": ("tls", tls.security(stranger).get_connection_args("client")),
        "no certificate": ("tls", {"ssl_context": trusting, "require_encryption": True}),
        "plain": ("tcp", Security(require_encryption=False).get_connection_args("client")),
    }
    found = {}
    async with Scheduler(
        host="127.0.0.1", port=0, protocol="tls", security=tls.security(own), dashboard_address="127.0.0.1:0"
    ) as scheduler:
        for name, (protocol, arguments) in who.items():
            address = f"{protocol}://{scheduler.address.partition('://')[2]}"
            seconds = 60 if name == "ours" else 5  # who is refused may never be answered
            try:
                comm = await connect(address, timeout=seconds, **arguments)
                await comm.write({"op": "identity", "reply": True})
                answer = await asyncio.wait_for(comm.read(), seconds)
                found[name] = "identity" if answer["type"] == "Scheduler" else "another answer"
            except (OSError, TimeoutError):
                found[name] = "refused"
    return found


def test_a_run_with_tls(toys, monkeypatch):
    monkeypatch.delenv("OBJECTFOLDER_TLS", raising=False)
    with runner(Place(workers=1, tls=True), toys.root, 2) as started:
        (end,) = run(started, job(toys, "good"))
    assert end.worker.startswith("tls://127.0.0.1:")
    assert end.outcome.failure is None
    assert (toys.root / tls.DEFAULT / tls.KEY).exists()


def test_listening_openly_is_said_so(capsys, certificates):
    for address in ("tcp://127.0.0.1:8786", "localhost", "tcp://[::1]:8786"):
        tls.warn_if_open(address, None)
    tls.warn_if_open("tls://10.0.0.1:8786", certificates)
    assert capsys.readouterr().err == ""
    for address in ("tcp://10.0.0.1:8786", "0.0.0.0", "tcp://head:8786"):
        tls.warn_if_open(address, None)
        assert f"{address} is reached from other machines without TLS" in capsys.readouterr().err
