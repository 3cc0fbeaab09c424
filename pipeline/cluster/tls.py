"""Certificates by which scheduler, workers and client know one another: one authority, one certificate.

Dask runs the code of whoever connects, so who holds the certificate may run code and nobody else may.
The authority's key is thrown away once it has signed the one certificate.
"""

import datetime
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from objectfolder.errors import InputError

FOLDER = "OBJECTFOLDER_TLS"
DEFAULT = Path(".objectfolder") / "tls"
AUTHORITY, CERTIFICATE, KEY = "authority.pem", "certificate.pem", "key.pem"
FILES = (AUTHORITY, CERTIFICATE, KEY)
LOOPBACK = ("localhost", "::1")
VALID_DAYS = 3650
SKEW_DAYS = 1  # of clocks that are late


def folder_of(root: Path, wanted: bool) -> Path | None:
    """Return the folder of the certificates; None where nothing is to be encrypted.

    Parameters
    ----------
    root
        The data folder.
    wanted
        Whether the place asks for TLS. ``OBJECTFOLDER_TLS`` (a folder) asks for it as well.
    """
    named = os.environ.get(FOLDER)
    if named:
        return Path(named)
    return root / DEFAULT if wanted else None


def make(folder: Path) -> None:
    """Write an authority, a certificate and its key into `folder`, unless they are there.

    Raises
    ------
    InputError
        The package that makes them is missing, or the folder holds some of them only.
    """
    if any((folder / name).exists() for name in FILES):
        check(folder)
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(prefix=".tls-", dir=folder.parent))  # for its owner alone
    try:
        for name, content in _new_certificates().items():
            descriptor = os.open(made / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
        try:
            made.rename(folder)
        except OSError:
            check(folder)  # another run was first
    finally:
        shutil.rmtree(made, ignore_errors=True)


def check(folder: Path) -> None:
    """Make sure that `folder` holds what `make` writes.

    Raises
    ------
    InputError
        A file that is missing or that this user may not read.
    """
    for name in FILES:
        if not os.access(folder / name, os.R_OK):
            remedy = f"Copy the folder {DEFAULT} of the driver, or set {FOLDER} to a copy of it."
            raise InputError(str(folder / name), "is missing or may not be read", remedy)


def security(folder: Path) -> Any:
    """Return Dask's settings (`distributed.Security`) for the certificates in `folder`.

    Raises
    ------
    InputError
        As `check`.
    """
    from distributed import Security

    check(folder)
    pair = {"cert": str(folder / CERTIFICATE), "key": str(folder / KEY)}
    roles = ("scheduler", "worker", "client")
    files = {f"tls_{role}_{part}": path for role in roles for part, path in pair.items()}
    return Security(require_encryption=True, tls_ca_file=str(folder / AUTHORITY), **files)


def warn_if_open(address: str, folder: Path | None) -> None:
    """Say so where processes would listen beyond this machine and speak to anybody."""
    host = urlsplit(address if "://" in address else f"tcp://{address}").hostname or ""
    if folder is None and host not in LOOPBACK and not host.startswith("127."):
        print(
            f"warning: {address} is reached from other machines without TLS: whoever connects may run code "
            "as this user. Set tls: true for the place, or OBJECTFOLDER_TLS.",
            file=sys.stderr,
        )


def _new_certificates() -> dict[str, bytes]:
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
        from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
    except ImportError as error:
        remedy = "pip install 'objectfolder-factory[factory]'"
        raise InputError("TLS", "the package cryptography is not installed", remedy) from error

    now = datetime.datetime.now(datetime.UTC)
    names = {
        role: x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"objectfolder {role}")])
        for role in ("authority", "cluster")
    }

    def signed(role: str, key: Any, by: Any, extensions: list[tuple[Any, bool]]) -> Any:
        builder = (
            x509.CertificateBuilder()
            .subject_name(names[role])
            .issuer_name(names["authority"])
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - datetime.timedelta(days=SKEW_DAYS))
            .not_valid_after(now + datetime.timedelta(days=VALID_DAYS))
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(by.public_key()), critical=False
            )
        )
        for extension, critical in extensions:
            builder = builder.add_extension(extension, critical=critical)
        return builder.sign(by, hashes.SHA256())

    def usage(signs_certificates: bool) -> Any:
        return x509.KeyUsage(
            digital_signature=not signs_certificates,
            content_commitment=False,
            key_encipherment=False,
            data_encipherment=False,
            key_agreement=False,
            key_cert_sign=signs_certificates,
            crl_sign=signs_certificates,
            encipher_only=False,
            decipher_only=False,
        )

    authority_key, key = (ec.generate_private_key(ec.SECP256R1()) for _ in range(2))
    both_sides = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
    authority = signed(
        "authority",
        authority_key,
        authority_key,
        [(x509.BasicConstraints(True, 0), True), (usage(True), True)],
    )
    certificate = signed(
        "cluster",
        key,
        authority_key,
        [(x509.BasicConstraints(False, None), True), (usage(False), True), (both_sides, False)],
    )
    pem = serialization.Encoding.PEM
    return {
        AUTHORITY: authority.public_bytes(pem),
        CERTIFICATE: certificate.public_bytes(pem),
        KEY: key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()),
    }
