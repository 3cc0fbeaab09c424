"""Requests over HTTP: urllib3 retries them; if that fails, an error names the remedy."""

import contextlib
import itertools
import logging
import re
import time
from collections.abc import Iterator, Mapping
from urllib.parse import urlsplit

import requests
from requests.adapters import HTTPAdapter
from urllib3 import BaseHTTPResponse
from urllib3.exceptions import HTTPError, InvalidHeader, ProtocolError
from urllib3.util import Retry

from objectfolder import __version__
from objectfolder.errors import InputError

# Its warnings of every retry would break the line that shows progress.
logging.getLogger("urllib3.connectionpool").setLevel(logging.ERROR)

USER_AGENT = f"objectfolder-factory/{__version__}"
CONNECT_S = 10.0
LONGEST_WAIT_S = 120.0
"""Of a server's Retry-After; a request that is to wait longer fails at once."""
BACKOFF_MAX_S = 30.0
RETRIED_STATUSES = (408, 425, 429, 500, 502, 503, 504)
MOST_REDIRECTS = 8
BLOCK = 256 << 10  # bytes
LEAST_BYTES = 64 << 10
"""Bytes that must arrive within the timeout; a slower connection is given up."""
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


class PoliteRetry(Retry):
    """urllib3's retries; they end where a server asks for a wait of more than `LONGEST_WAIT_S`."""

    def get_retry_after(self, response: BaseHTTPResponse) -> float | None:
        """Return the server's Retry-After in seconds; None where it says none that can be read."""
        try:
            wait_s = super().get_retry_after(response)
        except InvalidHeader:
            return None
        if wait_s is not None and wait_s > LONGEST_WAIT_S:
            raise requests.exceptions.RetryError(f"Retry-After {wait_s:.0f} s")
        return wait_s


def retry_policy(retries: int, backoff_s: float) -> Retry:
    """Return when to ask again: `retries` times; the second wait is `backoff_s`, each next one doubles."""
    return PoliteRetry(
        total=retries,
        other=0,  # certificates and refused tunnels, which do not mend themselves
        backoff_factor=backoff_s / 2,
        backoff_max=BACKOFF_MAX_S,
        status_forcelist=RETRIED_STATUSES,
        raise_on_status=False,
    )


class HttpClient:
    """Asks servers for content.

    Parameters
    ----------
    proxies
        By scheme, ``{"https": "http://proxy:3128"}``; the environment's variables hold for others.
    mirrors
        Starts of addresses and what stands in their place; the longest that fits is taken.
    retry
        When to ask again.
    timeout_s
        Without a byte.

    Raises
    ------
    InputError
        A mirror that is no address.
    """

    def __init__(
        self,
        *,
        proxies: Mapping[str, str] | None,
        mirrors: Mapping[str, str] | None,
        retry: Retry,
        timeout_s: float,
    ) -> None:
        self._proxies = dict(proxies or {})
        self._mirrors = dict(sorted((mirrors or {}).items(), key=lambda pair: -len(pair[0])))
        for address in (*self._mirrors, *self._mirrors.values()):
            check_address(address)
        self._timeout_s = timeout_s
        self._session = _session(retry)

    def address(self, url: str) -> str:
        """Return the address that is asked for `url`: a mirror's where there is one."""
        for start, replacement in self._mirrors.items():
            if url.startswith(start):
                return replacement + url.removeprefix(start)
        return url

    @contextlib.contextmanager
    def get(self, url: str, headers: Mapping[str, str]) -> Iterator[requests.Response]:
        """Ask for `url`; yield an answer of 200, 206 or 416, its body not read.

        Raises
        ------
        AbsentError, RefusedError, UnreachableError
            The server has nothing there, refuses, or cannot be reached.
        InputError
            Anything else that asking again will not change.
        """
        address = self.address(url)
        check_address(address)
        # Bytes are wanted as they are stored: hashes and ranges are of these.
        asked = {"Accept-Encoding": "identity", **headers}
        timeout = (min(CONNECT_S, self._timeout_s), self._timeout_s)
        try:
            response = self._session.get(
                address, headers=asked, stream=True, timeout=timeout, proxies=dict(self._proxies)
            )
        except requests.TooManyRedirects as error:
            finding = f"redirected more than {MOST_REDIRECTS} times"
            raise InputError(url, finding, "The source is broken or has moved; try a mirror.") from error
        except ValueError as error:  # what requests raises for addresses that it cannot ask
            raise InputError(
                url,
                f"it, its proxy or what it redirects to cannot be asked ({type(error).__name__})",
                "Only http and https are; check the address and the options for proxies and mirrors.",
            ) from error
        except (requests.RequestException, HTTPError, OSError) as error:
            raise _failure(url, error) from error
        with response:
            _check_answer(url, response)
            yield response

    def body(self, response: requests.Response, *, decoded: bool = False) -> Iterator[bytes]:
        """Yield a body as it arrives, with its ``Content-Encoding`` undone where `decoded`.

        Raises
        ------
        InterruptedBodyError
            The connection broke, or fewer than `LEAST_BYTES` arrived within the timeout.
        """
        count, since = 0, time.monotonic()
        while True:
            try:
                # Unlike `read`, this returns the bytes that have arrived, so that a slow server is noticed.
                block = response.raw.read1(BLOCK, decode_content=decoded)
            except (HTTPError, OSError) as error:
                raise InterruptedBodyError(_finding(error)) from error
            if not block:
                return
            yield block
            count += len(block)
            if count >= LEAST_BYTES:
                count, since = 0, time.monotonic()
            elif time.monotonic() - since > self._timeout_s:
                raise InterruptedBodyError("its server is too slow")


def _session(retry: Retry) -> requests.Session:
    session = requests.Session()
    session.headers.update({"User-Agent": USER_AGENT})
    session.max_redirects = MOST_REDIRECTS
    session.hooks["response"].append(_close_redirect)
    for scheme in ("http://", "https://"):
        session.mount(scheme, HTTPAdapter(max_retries=retry))
    return session


def check_address(address: str) -> None:
    """Raise `InputError` for what is no address of the web."""
    try:
        parts = urlsplit(address)
        right = parts.scheme.lower() in ("http", "https") and bool(parts.hostname)
    except ValueError:
        right = False
    if not right:
        raise InputError(address, "no address that begins with http:// or https://", "Correct the address.")


def _close_redirect(response: requests.Response, **_: object) -> None:
    if response.is_redirect:
        response.raw.close()  # requests would read its body to the end, however long it is


def _check_answer(url: str, response: requests.Response) -> None:
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


def _failure(url: str, error: Exception) -> InputError:
    """Return the error of a request without an answer."""
    said = str(error)
    if isinstance(error, requests.exceptions.SSLError) and "CERTIFICATE_VERIFY_FAILED" in said:
        return InputError(
            url,
            "its certificate is not to be trusted",
            "Check the clock and the address; for a proxy that opens connections, name its authority's "
            "certificate in REQUESTS_CA_BUNDLE.",
        )
    if tunnel := re.search(r"Tunnel connection failed: (4\d\d)", said):
        return RefusedError(url, f"refused by its proxy ({tunnel[1]})", "Check the proxy and its password.")
    return UnreachableError(url, f"cannot be fetched: {_finding(error)}", RETRY_REMEDY)


def _finding(error: Exception) -> str:
    """Return what happened, without addresses: a proxy's may have a password in it."""
    said = str(error)
    found = next((finding for sign, finding in FINDINGS.items() if sign in said), None)
    return found or f"the connection was lost ({type(error).__name__})"
