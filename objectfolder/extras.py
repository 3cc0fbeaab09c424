"""Optional packages: an import that fails is one error, which names the extra that brings the package."""

from collections.abc import Iterator
from contextlib import contextmanager

from objectfolder.errors import MissingPackageError


def missing_package(package: str, extra: str, finding: str = "is not installed") -> MissingPackageError:
    """Return the error of a package that an extra of the project brings."""
    return MissingPackageError(package, finding, f'pip install "objectfolder-factory[{extra}]"')


@contextmanager
def needs_extra(extra: str) -> Iterator[None]:
    """Import optional packages inside this context; they come with one extra of the project.

    Raises
    ------
    MissingPackageError
        One of them is not installed, or cannot be imported.

    Examples
    --------
    >>> with needs_extra("video"):
    ...     import av
    """
    try:
        yield
    except ImportError as error:
        package = (error.name or "").partition(".")[0]
        if package in ("objectfolder", "pipeline"):  # a defect of ours
            raise
        absent = isinstance(error, ModuleNotFoundError) and error.name == package
        finding = "is not installed" if absent else f"cannot be imported ({error})"
        raise missing_package(package or "a package", extra, finding) from error
