"""Requests over HTTP: urllib3 retries them; if that fails, an error names the remedy."""

import contextlib
import ipaddress
import itertools
import logging
import re
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any
from urllib.parse import urljoin, urlsplit

import requests
from requests.adapters import HTTPAdapter
from urllib3 import BaseHTTPResponse, HTTPConnectionPool, HTTPSConnectionPool
from urllib3.connection import HTTPConnection, HTTPSConnection
from urllib3.exceptions import HTTPError, ProtocolError
from urllib3.util import Retry

from objectfolder import __version__
from objectfolder.errors import InputError

# Its warnings of every retry would break the line that shows progress.
logging.getLogger("urllib3.connectionpool").setLevel(logging.ERROR)

USER_AGENT = f"objectfolder-factory/{__version__}"
LONGEST_WAIT_S = 120.0
"""Of a server's Retry-After; a request that is to wait longer fails at once."""
BACKOFF_MAX_S = 30.0
RETRIED_STATUSES = (408, 425, 429, 500, 502, 503, 504)
MOST_REDIRECTS = 8
BLOCK = 256 << 10  # bytes
LEAST_BYTES = 64 << 10
"""Bytes that must arrive within the timeout; a slower connection is given up."""
HEADERS_S = 60.0
"""Within which the headers of an answer must be there; the timeout is of each piece of them alone."""
RETRY_REMEDY = "Try again later, or check the network, proxy or mirror: what was downloaded is kept."

FINDINGS = {
    "ProxyError": "its proxy cannot be reached or refuses",
    "imed out": "its server does not answer in time",
    "NameResolutionError": "its server's name is not known here, or there is no network",
    "Connection refused": "its server refuses connections",
    "Retry-After": "its server asks for a longer wait than this program waits",
}
"""By a part of the library's message."""


class AbsentError(InputError):
    """An address at which there is nothing: its server answers 404 or 410."""


class RefusedError(InputError):
    """An address that its server or a proxy refuses: another 4xx, which some give for what is not there."""


class UnreachableError(InputError):
    """An address whose server fails however often it is asked."""


class InterruptedBodyError(ProtocolError):
    """A body that ended or stalled before it was whole."""


class InwardRedirectError(requests.RequestException):
    """A redirection from another machine to this one or to what only its own link reaches."""


class _HeadersWithin:
    """A connection on which the headers of an answer come within `HEADERS_S`."""

    sock: socket.socket | None

    def getresponse(self, *arguments: Any, **options: Any) -> Any:
        """Return the answer; raise TimeoutError for one whose headers trickle."""
        late = threading.Event()

        def end() -> None:
            late.set()
            with contextlib.suppress(OSError):
                if self.sock is not None:
                    self.sock.shutdown(socket.SHUT_RDWR)

        timer = threading.Timer(HEADERS_S, end)
        timer.daemon = True
        timer.start()
        try:
            answer = super().getresponse(*arguments, **options)  # type: ignore[misc]
        except (HTTPError, OSError, ValueError) as error:
            if late.is_set():
                raise TimeoutError("timed out") from error
            raise
        finally:
            timer.cancel()
        if late.is_set():  # cut short, the headers pass for whole
            raise TimeoutError("timed out")
        return answer


class _PlainConnection(_HeadersWithin, HTTPConnection):
    pass


class _EncryptedConnection(_HeadersWithin, HTTPSConnection):
    pass


class _PlainPool(HTTPConnectionPool):
    ConnectionCls = _PlainConnection


class _EncryptedPool(HTTPSConnectionPool):
    ConnectionCls = _EncryptedConnection


class _Adapter(HTTPAdapter):
    def init_poolmanager(self, *arguments: Any, **options: Any) -> None:
        """Let its connections have a deadline for headers."""
        super().init_poolmanager(*arguments, **options)
        self.poolmanager.pool_classes_by_scheme = {"http": _PlainPool, "https": _EncryptedPool}

    def proxy_manager_for(self, proxy: str, **options: Any) -> Any:
        """Let connections to a proxy have it, too."""
        manager = super().proxy_manager_for(proxy, **options)
        manager.pool_classes_by_scheme = {"http": _PlainPool, "https": _EncryptedPool}
        return manager


class _Session(requests.Session):
    def get_redirect_target(self, resp: requests.Response) -> str | None:
        """Return where an answer sends; raise `InwardRedirectError` where that leads inwards."""
        target: str | None = super().get_redirect_target(resp)
        if target and is_inward(urljoin(resp.url, target)) and not is_inward(resp.url):
            raise InwardRedirectError(urljoin(resp.url, target))
        return target


def is_inward(url: str) -> bool:
    """Return whether an address is of this machine, or of its own link: others cannot ask there, it can."""
    try:
        addresses = socket.getaddrinfo(urlsplit(url).hostname, None)
    except (OSError, ValueError):  # it has no such name, or a proxy knows it
        return False
    for *_, place in addresses:
        host = ipaddress.ip_address(str(place[0]).partition("%")[0])
        host = getattr(host, "ipv4_mapped", None) or host
        if host.is_loopback or host.is_link_local or host.is_unspecified:
            return True
    return False


class PoliteRetry(Retry):
    """urllib3's retries; they end where a server asks for a wait of more than `LONGEST_WAIT_S`."""

    def get_retry_after(self, response: BaseHTTPResponse) -> float | None:
        """Return the server's Retry-After in seconds; None where it says none."""
        wait_s = super().get_retry_after(response)
        if wait_s is not None and wait_s > LONGEST_WAIT_S:
            raise requests.exceptions.RetryError(f"Retry-After {wait_s:.0f} s")
        return wait_s


def retrying_session(retries: int, backoff_s: float) -> tuple[requests.Session, Retry]:
    """Return a session that names this software, and when it asks again: see `download.Downloader`."""
    retry = PoliteRetry(
        total=retries,
        other=0,  # certificates and refused tunnels, which do not mend themselves
        backoff_factor=backoff_s / 2,
        backoff_max=BACKOFF_MAX_S,
        status_forcelist=RETRIED_STATUSES,
        raise_on_status=False,
    )
    session = _Session()
    # Hashes and ranges are of the stored bytes.
    session.headers.update({"User-Agent": USER_AGENT, "Accept-Encoding": "identity"})
    session.max_redirects = MOST_REDIRECTS
    for scheme in ("http://", "https://"):
        session.mount(scheme, _Adapter(max_retries=retry))
    return session, retry


def check_answer(url: str, response: requests.Response) -> None:
    """Raise `AbsentError`, `RefusedError` or `UnreachableError` unless the status is 200, 206 or 416.

    Raises
    ------
    InputError
        A redirection left https.
    """
    chain = [urlsplit(step.url).scheme for step in (*response.history, response)]
    if ("https", "http") in itertools.pairwise(chain):
        raise InputError(
            url,
            "redirected from https to http, where anyone on the way may change it",
            "Use a mirror that serves it by https.",
        )
    status = response.status_code
    if status in (200, 206, 416):
        return
    if status in RETRIED_STATUSES or status >= 500:
        raise UnreachableError(url, f"cannot be fetched: its server answers {status}", RETRY_REMEDY)
    if status in (404, 410):
        remedy = "Check the name, or whether the source has moved it or is mirrored."
        raise AbsentError(url, f"not there ({status})", remedy)
    remedy = "Check the name; if it is right, try it in a browser, or use a mirror or proxy."
    raise RefusedError(url, f"refused by its server or a proxy ({status})", remedy)


def failure(url: str, error: Exception) -> InputError:
    """Return the error of a request without an answer."""
    text = str(error)
    if isinstance(error, requests.TooManyRedirects):
        finding = f"redirected more than {MOST_REDIRECTS} times"
        return InputError(url, finding, "The source is broken or has moved; try a mirror.")
    if isinstance(error, InwardRedirectError):
        finding = f"redirected to {urlsplit(text).hostname}, which is this machine or reached by it alone"
        return InputError(url, finding, "No public source does that. Use a mirror.")
    if isinstance(error, ValueError):  # what requests raises for addresses that it cannot ask
        return InputError(
            url,
            f"it, its proxy or what it redirects to cannot be asked ({type(error).__name__})",
            "Only http and https are; check the address and the options for proxies and mirrors.",
        )
    if isinstance(error, requests.exceptions.SSLError) and "CERTIFICATE_VERIFY_FAILED" in text:
        return InputError(
            url,
            "its certificate cannot be verified",
            "Check the clock and the address; for a proxy that opens connections, name its authority's "
            "certificate in REQUESTS_CA_BUNDLE.",
        )
    if tunnel := re.search(r"Tunnel connection failed: (4\d\d)", text):
        return RefusedError(url, f"refused by its proxy ({tunnel[1]})", "Check the proxy and its password.")
    return UnreachableError(url, f"cannot be fetched: {_finding(error)}", RETRY_REMEDY)


def body(response: requests.Response, timeout_s: float) -> Iterator[bytes]:
    """Yield a body as it arrives.

    Raises
    ------
    InterruptedBodyError
        The connection broke, or fewer than `LEAST_BYTES` arrived within the timeout.
    """
    count, since = 0, time.monotonic()
    while True:
        try:
            # Unlike `read`, this returns the bytes that have arrived, so that a slow server is noticed.
            block = response.raw.read1(BLOCK, decode_content=False)
        except (HTTPError, OSError) as error:
            raise InterruptedBodyError(_finding(error)) from error
        if not block:
            return
        yield block
        count += len(block)
        if count >= LEAST_BYTES:
            count, since = 0, time.monotonic()
        elif time.monotonic() - since > timeout_s:
            raise InterruptedBodyError("its server is too slow")


def _finding(error: Exception) -> str:
    """Return what happened, without addresses: a proxy's may have a password in it."""
    text = str(error)
    cause = next((finding for sign, finding in FINDINGS.items() if sign in text), None)
    return cause or f"the connection was lost ({type(error).__name__})"
