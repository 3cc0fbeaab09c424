"""Texts that others wrote, as they may be shown in a terminal."""

import textwrap


def printable(text: str) -> str:
    """Return a text without what would command a terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def wrapped(text: str, width: int, indent: str = "") -> list[str]:
    """Return a printable text as lines of a width, those after the first indented by two more."""
    return textwrap.wrap(
        printable(text), width, initial_indent=indent, subsequent_indent=f"{indent}  ", break_on_hyphens=False
    )
