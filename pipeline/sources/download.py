"""Files from servers into a cache: resumed, verified, and never half there."""

import hashlib
import io
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import timedelta
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import Any, BinaryIO

import requests

from objectfolder.errors import FormatError, InputError
from pipeline.sources.cached_file import CachedFile, Digests, Whole, writing
from pipeline.sources.patience import Patience
from pipeline.sources.web import Transient, Web, blocks, check_address

LIMIT_BYTES = 2 << 30
LIMIT_JSON_BYTES = 32 << 20
LEAST_AGE = timedelta(seconds=60)  # of a file that Last-Modified tells from its other versions
Progress = Callable[[str, int, int | None], None]
_STRONG_TAG = re.compile(r'"[!#-~]*"')
_CONTENT_RANGE = re.compile(r"bytes (\d+)-\d+/(\d+|\*)")


class _TooLargeError(InputError):
    pass


@dataclass(frozen=True)
class _Expected:
    """What the caller knows of a file."""

    sha256: str | None
    md5: str | None
    size: int | None
    limit_bytes: int

    @property
    def hashed(self) -> bool:
        return self.sha256 is not None or self.md5 is not None

    def difference(self, found: Digests) -> str:
        """Return how a file is another than expected; empty where it is not."""
        for name in ("size", "sha256", "md5"):
            wanted, is_ = getattr(self, name), getattr(found, name)
            if wanted is not None and str(wanted).lower() != str(is_):
                return f"its {name} is {is_}, not {wanted}"
        return ""


class Downloader:
    """Fetches files into a cache that processes may share.

    Parameters
    ----------
    cache
        Folder; a file lies in it under its address.
    proxies
        By scheme, ``{"https": "http://proxy:3128"}``; where none is given for a scheme, the usual
        variables of the environment hold (``HTTPS_PROXY``, ``NO_PROXY``).
    mirrors
        Starts of addresses, and what is asked instead of them. The cache keeps files under the
        addresses as they were given.
    requests_per_second
        To one host, at most.
    patience_s
        How long to go on trying while nothing new comes, waits included. A server that asks for a longer
        wait is given up at once.
    timeout_s
        Without a byte, after which a connection is given up and another tried.
    backoff_s
        Wait after a second failure in a row; it doubles from there.
    progress
        Called with the address, the bytes there are so far, which become fewer when it has to start
        again, and those of the whole where they are known.

    Raises
    ------
    InputError
        A mirror that is no address.
    """

    def __init__(
        self,
        cache: Path,
        *,
        proxies: Mapping[str, str] | None = None,
        mirrors: Mapping[str, str] | None = None,
        requests_per_second: float = 2.0,
        patience_s: float = 120.0,
        timeout_s: float = 30.0,
        backoff_s: float = 1.0,
        progress: Progress | None = None,
    ) -> None:
        self._cache = Path(cache)
        self._web = Web(
            proxies=proxies, mirrors=mirrors, requests_per_second=requests_per_second, timeout_s=timeout_s
        )
        self._patience_s = patience_s
        self._backoff_s = backoff_s
        self._progress = progress or (lambda url, count, total: None)

    def file(
        self,
        url: str,
        *,
        sha256: str | None = None,
        md5: str | None = None,
        size: int | None = None,
        limit_bytes: int = LIMIT_BYTES,
    ) -> Path:
        """Return a verified file in the cache, fetched where it is not there.

        Parameters
        ----------
        sha256, md5, size
            Of the content, where they are known. A file in the cache is checked against them, and against
            what it was when it came.
        limit_bytes
            The most that it may be.

        Raises
        ------
        AbsentError, RefusedError
            Its server answers 404 or 410, or another 4xx that does not pass.
        InputError
            It cannot be fetched or written, or is too large.
        FormatError
            It is another than expected.
        """
        check_address(url)
        expected = _Expected(sha256, md5, size, limit_bytes)
        cached = CachedFile(self._cache, url)
        with cached.alone():
            found = cached.kept()
            if found is None or expected.difference(found):
                self._fetch(url, cached, expected)
        return cached.path

    def json(self, url: str, limit_bytes: int = LIMIT_JSON_BYTES) -> Any:
        """Return a small document, which is not kept; see `file` for what is raised."""
        patience = Patience(url, self._patience_s, self._backoff_s)
        while True:
            content = io.BytesIO()
            try:
                with self._web.get(url, {"Accept": "application/json"}) as response:
                    self._pour(url, response, content, None, limit_bytes, patience, decoded=True)
                break
            except Transient as problem:
                patience.wait(problem)
        try:
            return json.loads(content.getvalue())
        except (ValueError, RecursionError) as error:
            raise FormatError(
                url, "its server answers with no JSON", "Look at it in a browser: a proxy may stand between."
            ) from error

    def forget(self, url: str) -> None:
        """Remove what the cache has of an address, as when its content turns out to be damaged."""
        check_address(url)
        cached = CachedFile(self._cache, url)
        with cached.alone():
            cached.forget()

    def _fetch(self, url: str, cached: CachedFile, expected: _Expected) -> None:
        """Bring all of a file, verify it, and give it its name."""
        patience = Patience(url, self._patience_s, self._backoff_s)
        wrong = False
        while True:
            try:
                resumed = self._attempt(url, cached, expected, patience)
            except Transient as problem:
                patience.wait(problem)
                continue
            with writing(cached.partial):
                found = Digests.of(cached.partial)
            difference = expected.difference(found)
            if not difference:
                cached.finish(found)
                return
            cached.discard()
            if wrong or not resumed:  # what was there before may have been another's
                raise FormatError(
                    url,
                    f"not what is known of it: {difference}",
                    "Nothing of it is kept. The source has changed or a proxy stands between: compare "
                    "with a mirror, and record what is new only if it is right.",
                )
            wrong = True

    def _attempt(self, url: str, cached: CachedFile, expected: _Expected, patience: Patience) -> bool:
        """Append what is missing; return whether some was there before."""
        count, whole = cached.come()
        # A mirror's address may have a password in it, which is not for the disk.
        asked = hashlib.sha256(self._web.address(url).encode("utf-8", "surrogatepass")).hexdigest()
        if whole is None or whole.asked != asked or not (whole.validator or expected.hashed):
            count, whole = 0, None
        if whole is not None and count == whole.total:
            return True
        headers = {}
        if whole is not None and count:
            headers["Range"] = f"bytes={count}-"
            if whole.validator:
                headers["If-Range"] = whole.validator
        with self._web.get(url, headers) as response:
            resumed = bool(headers) and response.status_code == 206
            if resumed and whole is not None and _continues(response, count, whole):
                total = whole.total
            elif response.status_code == 200:
                resumed, count = False, 0
                total = _length(response)
                if total is None and not _chunked(response):
                    _check_end_is_known(url, expected)
                    total = expected.size
                if total is not None:
                    _check_size(url, total, expected)
                cached.begin(Whole(asked, _validator(response), total))
            else:
                cached.discard()
                raise Transient(f"its server sends another part than asked for ({response.status_code})")
            if total is not None:
                cached.check_space(total - count)
            with writing(cached.partial):
                file = cached.partial.open("ab")
            with file:
                try:
                    self._pour(url, response, file, total, expected.limit_bytes, patience, start=count)
                except _TooLargeError:
                    cached.discard()
                    raise
        return resumed

    def _pour(
        self,
        url: str,
        response: requests.Response,
        file: BinaryIO,
        total: int | None,
        limit_bytes: int,
        patience: Patience,
        *,
        start: int = 0,
        decoded: bool = False,
    ) -> None:
        """Write a body as it comes."""
        count = start
        self._progress(url, count, total)
        patience.answered()
        for block in blocks(response, decoded):
            count += len(block)
            _check_limit(url, count, limit_bytes)
            if total is not None and count > total:
                raise Transient(f"its server sends more than the {total} bytes it told of")
            with writing(Path(getattr(file, "name", url))):
                file.write(block)
                file.flush()
            patience.came(count)
            self._progress(url, count, total)
        if total is not None and count < total:
            raise Transient(f"{count} bytes came of {total}")


def _length(response: requests.Response) -> int | None:
    if _chunked(response):
        return None
    text = response.headers.get("Content-Length", "")
    return int(text) if re.fullmatch(r"[0-9]{1,18}", text) else None


def _chunked(response: requests.Response) -> bool:
    """Whether the body marks its own end."""
    return response.headers.get("Transfer-Encoding", "").lower() == "chunked"


def _validator(response: requests.Response) -> str:
    """Return what tells this version of a file from others, byte by byte."""
    tag = response.headers.get("ETag", "")
    if _STRONG_TAG.fullmatch(tag):
        return tag
    modified = response.headers.get("Last-Modified", "")
    try:
        age = parsedate_to_datetime(response.headers.get("Date", "")) - parsedate_to_datetime(modified)
    except (ValueError, TypeError):  # absent, no dates, or of which one has no time zone
        return ""
    # A time of whole seconds does not tell a file from what it became within that second.
    return modified if age >= LEAST_AGE else ""


def _continues(response: requests.Response, count: int, whole: Whole) -> bool:
    """Whether an answer to a request for the rest of a file is the rest of it."""
    match = _CONTENT_RANGE.fullmatch(response.headers.get("Content-Range", "").strip())
    if match is None or int(match[1]) != count:
        return False
    if whole.total is not None and match[2] not in ("*", str(whole.total)):
        return False
    return not whole.validator or _validator(response) in ("", whole.validator)


def _check_end_is_known(url: str, expected: _Expected) -> None:
    if expected.size is None and not expected.hashed:
        raise InputError(
            url,
            "its server does not say how long it is, so a cut connection would pass for its end",
            "Use a mirror, or record its size or sha256.",
        )


def _check_size(url: str, total: int, expected: _Expected) -> None:
    _check_limit(url, total, expected.limit_bytes)
    if expected.size is not None and total != expected.size:
        raise FormatError(
            url,
            f"not what is known of it: its size is {total}, not {expected.size}",
            "The source has changed or a proxy stands between: compare with a mirror, and record what is "
            "new only if it is right.",
        )


def _check_limit(url: str, count: int, limit_bytes: int) -> None:
    if count > limit_bytes:
        raise _TooLargeError(
            url,
            f"larger than {limit_bytes} bytes",
            "Nothing of this kind should be; look at what is there before fetching it.",
        )
