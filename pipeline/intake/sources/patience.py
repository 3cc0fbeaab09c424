"""How long to go on with a server: as long as bytes come."""

import time

from urllib3.util import Retry

from objectfolder.errors import InputError
from pipeline.intake.sources.web import Transient

LEAST_BYTES = 64 << 10  # further than ever before, that count as getting on
MOST_WAIT_S = 30.0  # between attempts, unless the server asks for more


class Patience:
    """Waits between attempts at one address, and gives up when nothing new comes for too long.

    A server that sends a byte at a time, or the same beginning again and again, is not getting on.

    Parameters
    ----------
    url
        Of what is fetched.
    seconds
        Without getting on, waits included, after which to give up.
    backoff_s
        The wait after a second failure in a row; it doubles from there.
    """

    def __init__(self, url: str, seconds: float, backoff_s: float) -> None:
        self._url = url
        self._seconds = seconds
        self._fresh = Retry(total=None, backoff_factor=backoff_s / 2, backoff_max=MOST_WAIT_S)
        self._retry = self._fresh
        self._furthest = 0
        self._since = self._answered = time.monotonic()

    def answered(self) -> None:
        """Take note that a server begins to send: it has as long again for it."""
        self._answered = time.monotonic()

    def came(self, position: int) -> None:
        """Take note of having so many bytes.

        Raises
        ------
        InputError
            Too few for too long.
        """
        now = time.monotonic()
        if position - self._furthest >= LEAST_BYTES:
            self._furthest, self._since, self._retry = position, now, self._fresh
        elif now - max(self._since, self._answered) > self._seconds:
            raise InputError(
                self._url,
                f"too slow: less than {LEAST_BYTES} new bytes came in {self._seconds:g} s",
                "Try again later, or use a mirror: what has come is kept.",
            )

    def wait(self, problem: Transient) -> None:
        """Wait until another attempt is due.

        Raises
        ------
        InputError
            There is to be none.
        """
        self._retry = self._retry.increment("GET", self._url, error=problem)
        wait_s = max(problem.after_s, self._retry.get_backoff_time())
        if time.monotonic() + wait_s - self._since > self._seconds:
            when = f"in {problem.after_s:.0f} s" if problem.after_s else "later"
            raise InputError(
                self._url,
                f"cannot be fetched: {problem.finding}, asked {len(self._retry.history)} times",
                f"Try again {when}, or check the network, proxy or mirror: what has come is kept.",
            ) from problem
        time.sleep(wait_s)
