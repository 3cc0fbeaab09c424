"""A finding of the check of a table of objects."""

from dataclasses import dataclass

ERROR = "error"
WARNING = "warning"
NOTE = "note"
SEVERITIES = (ERROR, WARNING, NOTE)


@dataclass(frozen=True)
class Finding:
    """A finding, and its remedy.

    Parameters
    ----------
    severity
        ``"error"``: wrong, or cannot be built; ``"warning"``: doubtful; ``"note"``: good to know.
    object_id
        Whose row it is.
    field
        Column that it is about.
    rule
        What found it: the name that the column `accepted` may list.
    found
        A phrase with numbers and units.
    remedy
        What to do.
    accepted
        Whether the row says that this was looked at and stays.
    """

    severity: str
    object_id: str
    field: str
    rule: str
    found: str
    remedy: str
    accepted: bool = False
