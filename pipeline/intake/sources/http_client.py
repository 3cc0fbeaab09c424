"""Requests over HTTP: urllib3 retries them; if that fails, an error names the remedy."""

import itertools
import logging
import re
from urllib.parse import urlsplit

import requests
from requests.adapters import HTTPAdapter
from urllib3 import BaseHTTPResponse
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
RETRY_REMEDY = "Try again later, or check the network, proxy or mirror: whole files are kept."

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
    session = requests.Session()
    session.headers.update(
        {"User-Agent": USER_AGENT, "Accept-Encoding": "identity"}
    )  # hashes are of stored bytes
    session.max_redirects = MOST_REDIRECTS
    for scheme in ("http://", "https://"):
        session.mount(scheme, HTTPAdapter(max_retries=retry))
    return session, retry


def check_answer(url: str, response: requests.Response) -> None:
    """Raise `AbsentError`, `RefusedError` or `UnreachableError` unless the status is 200.

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
    if status == 200:
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
    return UnreachableError(url, f"cannot be fetched: {finding_of(error)}", RETRY_REMEDY)


def finding_of(error: Exception) -> str:
    """Return what happened, without addresses: a proxy's may have a password in it."""
    text = str(error)
    cause = next((finding for sign, finding in FINDINGS.items() if sign in text), None)
    return cause or f"the connection was lost ({type(error).__name__})"
