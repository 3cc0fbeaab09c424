"""Numbers of things, in words."""


def counted(number: int, noun: str) -> str:
    """Return ``1 object`` or ``7 objects``.

    Examples
    --------
    >>> counted(1, "object"), counted(2, "touch")
    ('1 object', '2 touches')
    """
    plural = "es" if noun.endswith(("s", "x", "ch", "sh")) else "s"
    return f"{number} {noun}{'' if number == 1 else plural}"
