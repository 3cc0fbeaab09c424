"""The certificate by which scheduler, workers and client recognise one another.

Dask runs the code of whoever connects, so who holds the certificate's key may run code and nobody else may.
"""

import os
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from objectfolder.errors import InputError
from pipeline.cluster.places import SSH, Place

FILE = "OBJECTFOLDER_TLS"
LOOPBACK = ("localhost", "::1")
ROLES = ("scheduler", "worker", "client")
VALID = timedelta(days=365 * 20)
FIELDS = ("tls_ca_file", *(f"tls_{role}_{part}" for role in ROLES for part in ("cert", "key")))
MAKE = (
    "Make it with: umask 077; openssl req -x509 -newkey rsa:2048 -nodes -days 3650 -subj /CN=objectfolder "
    "-keyout tls.pem -out tls.pem; and give each machine a copy."
)


def security(place: Place, root: Path) -> Any:
    """Return Dask's settings (`distributed.Security`) of a place; None for no encryption.

    ``OBJECTFOLDER_TLS``, a file, goes before what the place says.

    Raises
    ------
    InputError
        A file that is missing or that others may read, or the place needs one and names none.
    """
    from distributed import Security

    path = os.environ.get(FILE) or place.tls
    if isinstance(path, str):
        return security_of_file(root / path)
    if not path or (place.address and not place.address.startswith("tls://")):
        return None
    if place.address or place.starts == SSH:
        finding = "the machines share no certificate"
        raise InputError("tls", finding, f"Name its file in the place, or in {FILE}. {MAKE}")
    certificate, key = _certificate()
    of_roles = {
        f"tls_{role}_{part}": text for role in ROLES for part, text in (("cert", certificate), ("key", key))
    }
    return Security(require_encryption=True, tls_ca_file=certificate, **of_roles)


def _certificate() -> tuple[str, str]:
    """Return a certificate for one run and its key, as PEM.

    It is valid for decades around now, unlike that of `distributed.Security.temporary`: clocks of hosts
    differ, and jump. It ends with the run, whose processes alone have it.
    """
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "objectfolder")])
    now = datetime.now(tz=UTC)
    certificate = x509.CertificateBuilder(
        subject_name=name, issuer_name=name, public_key=key.public_key(),
        serial_number=x509.random_serial_number(), not_valid_before=now - VALID, not_valid_after=now + VALID,
    ).sign(key, hashes.SHA256())  # fmt: skip
    pem = serialization.Encoding.PEM
    plain = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    return certificate.public_bytes(pem).decode(), key.private_bytes(pem, *plain).decode()


def security_of_file(file: Path) -> Any:
    """Return Dask's settings for a PEM file that holds a certificate, which all trust, and its key.

    Raises
    ------
    InputError
        It is missing or may not be read, or others may read it.
    """
    from distributed import Security

    if not os.access(file, os.R_OK):
        raise InputError(str(file), "is missing or may not be read", MAKE)
    if file.stat().st_mode & 0o077:
        raise InputError(str(file), "may be used by others", f"chmod 600 {file}")
    return Security(require_encryption=True, **dict.fromkeys(FIELDS, str(file)))


def as_mapping(settings: Any) -> dict[str, Any]:
    """Return `distributed.Security` of a file as plain data, which names the file and does not hold it."""
    return {name: getattr(settings, name) for name in ("require_encryption", *FIELDS)}


def warn_if_open(address: str) -> None:
    """Say so where processes listen beyond this machine and speak to anybody."""
    url = urlsplit(address)
    host = url.hostname or ""
    if url.scheme != "tls" and host not in LOOPBACK and not host.startswith("127."):
        print(
            f"warning: {address} is reached from other machines without TLS: whoever connects may run code "
            f"as this user. Set tls of the place, or {FILE}.",
            file=sys.stderr,
        )
