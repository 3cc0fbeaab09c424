"""What is known of a file before it comes, and whether it is that."""

from dataclasses import dataclass

from objectfolder.errors import FormatError, InputError
from pipeline.intake.sources.cached_file import Digests

REMEDY = (
    "Nothing of it is kept. The source has changed or a proxy stands between: compare with a mirror, and "
    "record what is new only if it is right."
)


class TooLargeError(InputError):
    """More bytes than anything of its kind should have."""


@dataclass(frozen=True)
class Expected:
    """A file as it is known; None for what is not.

    Parameters
    ----------
    url
        Its address, for errors.
    sha256, md5
        In hexadecimal digits.
    size
        Bytes.
    limit_bytes
        The most that it may be.
    """

    url: str
    sha256: str | None
    md5: str | None
    size: int | None
    limit_bytes: int

    @property
    def hashed(self) -> bool:
        """Whether parts of two versions would be told from one of them."""
        return self.sha256 is not None or self.md5 is not None

    def differs(self, found: Digests) -> str:
        """Return how a file is another, with both values; empty where it is not."""
        for name in ("size", "sha256", "md5"):
            wanted, value = getattr(self, name), getattr(found, name)
            if wanted is not None and str(wanted).lower() != str(value):
                return f"not what is known of it: its {name} is {value}, not {wanted}"
        return ""

    def check_end(self) -> None:
        """Raise `InputError` where a beginning would pass for the whole, of which no length is told."""
        if self.size is None and not self.hashed:
            raise InputError(
                self.url,
                "its server does not say how long it is, so a cut connection would pass for its end",
                "Use a mirror, or record its size or sha256.",
            )

    def check_size(self, total: int) -> None:
        """Raise `FormatError` or `TooLargeError` for what a server says of the size."""
        self.check_limit(total)
        if self.size is not None and total != self.size:
            finding = f"not what is known of it: its size is {total}, not {self.size}"
            raise FormatError(self.url, finding, REMEDY)

    def check_limit(self, count: int) -> None:
        """Raise `TooLargeError` once more has come than should."""
        if count > self.limit_bytes:
            remedy = "Nothing of this kind should be; look at what is there before fetching it."
            raise TooLargeError(self.url, f"larger than {self.limit_bytes} bytes", remedy)
