"""Texts of strangers, as they may be shown."""


def printable(text: str) -> str:
    """Return a text of strangers without what would command a terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
