"""Requests to servers of others: named, paced, bounded, and their failures told apart.

What may pass when asked again is a `Transient`; everything else is an error for the user.
"""

import contextlib
import itertools
import re
import ssl
import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import urlsplit

import requests
from requests.adapters import HTTPAdapter
from urllib3.exceptions import HTTPError, InvalidHeader
from urllib3.util import Retry

from objectfolder import __version__
from objectfolder.errors import InputError

USER_AGENT = f"objectfolder-factory/{__version__}"
CONNECT_S = 10.0
BLOCK = 256 << 10  # bytes read at most before they are written and told
MOST_REDIRECTS = 8
TRANSIENT = {408, 425, 429}  # and 500 and above


class Transient(Exception):
    """A failure that may be gone when asked again.

    Parameters
    ----------
    finding
        What happened, without secrets such as a password within a proxy's address.
    after_s
        When the server asks to be asked again.
    """

    def __init__(self, finding: str, after_s: float = 0.0) -> None:
        self.finding = finding
        self.after_s = after_s
        super().__init__(finding)


class AbsentError(InputError):
    """An address at which there is nothing: its server answers 404 or 410."""


class RefusedError(InputError):
    """An address that its server or a proxy refuses: another 4xx, which some give for what is not there."""


class Web:
    """Servers, as they are asked.

    Parameters
    ----------
    proxies
        By scheme, ``{"https": "http://proxy:3128"}``; the environment's variables hold for others.
    mirrors
        Starts of addresses and what stands in their place; the longest that fits is taken.
    requests_per_second
        To one host, at most, redirections included.
    timeout_s
        Without a byte.

    Raises
    ------
    InputError
        A proxy or mirror that is no address.
    """

    def __init__(
        self,
        *,
        proxies: Mapping[str, str] | None,
        mirrors: Mapping[str, str] | None,
        requests_per_second: float,
        timeout_s: float,
    ) -> None:
        self._proxies = dict(proxies or {})
        self._mirrors = dict(sorted((mirrors or {}).items(), key=lambda pair: -len(pair[0])))
        for address in (*self._mirrors, *self._mirrors.values()):
            check_address(address)
        self._pace = _Pace(requests_per_second)
        self._timeout = (min(CONNECT_S, timeout_s), timeout_s)
        self._sessions = threading.local()  # requests does not promise that threads may share one

    def address(self, url: str) -> str:
        """Return where `url` is asked for."""
        for start, replacement in self._mirrors.items():
            if url.startswith(start):
                return replacement + url.removeprefix(start)
        return url

    @contextlib.contextmanager
    def get(self, url: str, headers: Mapping[str, str]) -> Iterator[requests.Response]:
        """Ask for `url`; yield an answer of 200, 206 or 416, its body not read.

        Raises
        ------
        Transient
            No answer, or one that says that another may follow.
        AbsentError, RefusedError
            There is nothing at the address, or nothing for us.
        InputError
            Anything else that asking again will not change.
        """
        address = self.address(url)
        check_address(address)
        # Bytes are wanted as they are stored: hashes and ranges are of these.
        asked = {"Accept-Encoding": "identity", **headers}
        try:
            response = self._session().get(
                address, headers=asked, stream=True, timeout=self._timeout, proxies=dict(self._proxies)
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
            _check_redirects(url, response)
            _check_status(url, response)
            yield response

    def _session(self) -> requests.Session:
        if not hasattr(self._sessions, "session"):
            session = requests.Session()
            session.headers.clear()
            session.headers.update({"User-Agent": USER_AGENT, "Accept": "*/*"})
            session.max_redirects = MOST_REDIRECTS
            adapter = _Adapter(self._pace)
            session.mount("http://", adapter)
            session.mount("https://", adapter)
            self._sessions.session = session
        session = self._sessions.session
        session.cookies.clear()
        return session


def blocks(response: requests.Response, decoded: bool = False) -> Iterator[bytes]:
    """Yield the body as it comes; see `Web.get` for what is raised.

    Parameters
    ----------
    decoded
        Undo a ``Content-Encoding``; otherwise the bytes are those that the server stores.
    """
    while True:
        try:
            # Unlike `read`, this returns what is there: a slow server is seen to be slow.
            block = response.raw.read1(BLOCK, decode_content=decoded)
        except (requests.RequestException, HTTPError, OSError) as error:
            raise _failure(response.url, error) from error
        if not block:
            return
        yield block


class _Pace:
    """Turns at hosts, no two of one host closer than allowed."""

    def __init__(self, requests_per_second: float) -> None:
        self._gap_s = 1 / requests_per_second
        self._next: dict[str, float] = {}
        self._lock = threading.Lock()

    def wait(self, host: str) -> None:
        with self._lock:
            now = time.monotonic()
            turn = max(now, self._next.get(host, now))
            self._next[host] = turn + self._gap_s
        time.sleep(turn - now)


class _Adapter(HTTPAdapter):
    """Every request waits for its turn, those that redirections lead to included."""

    def __init__(self, pace: _Pace) -> None:
        super().__init__(max_retries=0)
        self._pace = pace

    def send(self, request: requests.PreparedRequest, *args: Any, **kwargs: Any) -> requests.Response:
        self._pace.wait(urlsplit(str(request.url)).netloc)
        response = super().send(request, *args, **kwargs)
        if response.is_redirect:
            response.raw.close()  # its body would be read to the end, however long it is
        return response


def check_address(address: str) -> None:
    """Raise `InputError` for what is no address of the web."""
    try:
        parts = urlsplit(address)
        right = parts.scheme.lower() in ("http", "https") and bool(parts.hostname)
    except ValueError:
        right = False
    if not right:
        raise InputError(address, "no address that begins with http:// or https://", "Correct the address.")


def _check_redirects(url: str, response: requests.Response) -> None:
    chain = [urlsplit(step.url).scheme for step in (*response.history, response)]
    if ("https", "http") in itertools.pairwise(chain):
        raise InputError(
            url,
            "redirected from https to http, where anyone on the way may change it",
            "Use a mirror that serves it by https.",
        )


def _check_status(url: str, response: requests.Response) -> None:
    status = response.status_code
    if status in (200, 206, 416):
        return
    if status in TRANSIENT or status >= 500:
        raise Transient(f"its server answers {status}", _retry_after(response))
    if status in (404, 410):
        raise AbsentError(
            url, f"not there ({status})", "Check the name, or whether the source has moved it or is mirrored."
        )
    if 400 <= status < 500:
        remedy = "Check the name; if it is right, try it in a browser, or use a mirror or proxy."
        raise RefusedError(url, f"refused by its server or a proxy ({status})", remedy)
    raise InputError(url, f"its server answers {status}", "Check the address, or use a mirror.")


def _retry_after(response: requests.Response) -> float:
    try:
        return Retry().get_retry_after(response.raw) or 0.0
    except InvalidHeader:
        return 0.0


def _failure(url: str, error: Exception) -> Exception:
    """Return what to raise for a connection that failed."""
    causes = list(_causes(error))
    for cause in causes:
        if isinstance(cause, ssl.SSLCertVerificationError):
            return InputError(
                url,
                f"its certificate is not to be trusted ({cause.verify_message})",
                "Check the clock and the address; for a proxy that opens connections, name its authority's "
                "certificate in REQUESTS_CA_BUNDLE.",
            )
        # A proxy's answer to a request for a tunnel comes as a text alone.
        if tunnel := re.search(r"Tunnel connection failed: (4\d\d)", str(cause)):
            return RefusedError(
                url, f"refused by its proxy ({tunnel[1]})", "Check the proxy and its password."
            )
    names = {type(cause).__name__ for cause in causes}
    if any("ProxyError" in name for name in names):
        return Transient("its proxy cannot be reached or refuses")
    if any("Timeout" in name for name in names):
        return Transient("its server does not answer in time")
    if names & {"gaierror", "NameResolutionError"}:
        return Transient("its server's name is not known here, or there is no network")
    if "ConnectionRefusedError" in names:
        return Transient("its server refuses connections")
    return Transient(f"the connection was lost ({type(causes[-1]).__name__})")


def _causes(error: BaseException) -> Iterator[BaseException]:
    """Yield an exception and what it came from, down to the first."""
    seen: list[BaseException] = []
    pending: BaseException | None = error
    while pending is not None and pending not in seen:
        seen.append(pending)
        yield pending
        inner = getattr(pending, "reason", None) or next(
            (value for value in pending.args if isinstance(value, BaseException)), None
        )
        pending = inner if isinstance(inner, BaseException) else pending.__cause__ or pending.__context__
