"""Errors that name the object or file, the finding and the remedy."""


def printable(text: object) -> str:
    """Replace characters that a terminal would obey by ``?``: parts of a text come from untrusted files."""
    return "".join(letter if letter.isprintable() or letter == "\n" else "?" for letter in str(text))


class ObjectFolderError(Exception):
    """Any failure a user can act on.

    Parameters
    ----------
    where
        The object, file or parameter concerned.
    finding
        What is wrong, with the offending value.
    remedy
        What to do about it.
    """

    def __init__(self, where: str, finding: str, remedy: str = "") -> None:
        self.where = where
        self.finding = finding
        self.remedy = remedy
        super().__init__(where, finding, remedy)

    def __str__(self) -> str:
        message = f"{self.where}: {self.finding}"
        return printable(f"{message}. {self.remedy}" if self.remedy else message)


class InputError(ObjectFolderError):
    """A mesh, texture, table or parameter that cannot be used as it is."""


class SimulationError(ObjectFolderError):
    """A simulation that did not reach its stated accuracy or could not run."""


class UnsolvableError(SimulationError):
    """A simulation that an object does not allow, on whatever machine it runs."""


class QueryError(ObjectFolderError, ValueError):
    """A query that an Object File cannot answer truthfully."""


class FormatError(ObjectFolderError):
    """A file that is truncated, foreign, or of an unknown version."""


class MissingPackageError(ObjectFolderError, ImportError):
    """A package that is optional, is needed here and cannot be imported; the remedy names its extra."""
