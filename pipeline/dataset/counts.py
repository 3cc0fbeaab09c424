"""Numbers of things, in words and in columns."""

from collections.abc import Sequence


def counted(number: int, noun: str) -> str:
    """Return ``1 object`` or ``7 objects``.

    Examples
    --------
    >>> counted(1, "object"), counted(2, "touch")
    ('1 object', '2 touches')
    """
    plural = "es" if noun.endswith(("s", "x", "ch", "sh")) else "s"
    return f"{number} {noun}{'' if number == 1 else plural}"


def columns(rows: Sequence[Sequence[str]], texts: int = 1) -> list[str]:
    """Return rows as lines; the first columns are texts, the others numbers.

    Examples
    --------
    >>> columns([("stage", "CPU s"), ("views", "9.5")])
    ['stage  CPU s', 'views    9.5']
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if index < texts else cell.rjust(width)
            for index, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
