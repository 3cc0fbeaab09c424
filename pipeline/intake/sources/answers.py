"""What a server's answer says of a file: how long it is, which version, which part."""

import re
from datetime import timedelta
from email.utils import parsedate_to_datetime

import requests

from pipeline.intake.sources.cached_file import Whole

LEAST_AGE = timedelta(seconds=60)  # of a file that Last-Modified tells from its other versions
_STRONG_TAG = re.compile(r'"[!#-~]*"')
_CONTENT_RANGE = re.compile(r"bytes (\d+)-\d+/(\d+|\*)")


def length(response: requests.Response) -> int | None:
    """Return the bytes of a body; None where its end will tell, or nothing does."""
    if marks_its_end(response):
        return None
    text = response.headers.get("Content-Length", "")
    return int(text) if re.fullmatch(r"[0-9]{1,18}", text) else None


def marks_its_end(response: requests.Response) -> bool:
    """Whether a body comes in chunks, of which the last says so."""
    return response.headers.get("Transfer-Encoding", "").lower() == "chunked"


def validator(response: requests.Response) -> str:
    """Return what tells this version of a file from any other, byte by byte; empty where nothing does."""
    tag = response.headers.get("ETag", "")
    if _STRONG_TAG.fullmatch(tag):
        return tag
    modified = response.headers.get("Last-Modified", "")
    try:
        age = parsedate_to_datetime(response.headers.get("Date", "")) - parsedate_to_datetime(modified)
    except (ValueError, TypeError, OverflowError):  # absent, no dates, or of which one has no time zone
        return ""
    # A time of whole seconds does not tell a file from what it became within that second.
    return modified if age >= LEAST_AGE else ""


def continues(response: requests.Response, count: int, whole: Whole) -> bool:
    """Return whether an answer to a request for the rest of a file after `count` bytes is the rest of it."""
    match = _CONTENT_RANGE.fullmatch(response.headers.get("Content-Range", "").strip())
    if response.status_code != 206 or match is None or int(match[1]) != count:
        return False
    if whole.total is not None and match[2] not in ("*", str(whole.total)):
        return False
    return not whole.validator or validator(response) in ("", whole.validator)
