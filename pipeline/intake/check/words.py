"""Words of ids, names and notes."""

import re

_PART = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")

# What follows is no word about the thing itself.
_PHRASES = re.compile(
    r"\b(magnifying|looking|hour)[ _-]?glass(es)?\b"
    r"|\biron[ _-]?man\b|\b(clothes|curling|waffle|soldering|steam|flat)[ _-]?irons?\b"
    r"|\bsteel[ _-]?(blue|gr[ae]y)\b|\bplastic[ _-]?free\b|\b(dust|drip|bed)[ _-]?pan\b",
    re.IGNORECASE,
)
_DENIED = re.compile(
    r"\b(?:not|no|never|without(?: an?)?|instead of|rather than) (?:of |an? |any )?[\w-]+", re.IGNORECASE
)


def words_of(text: str) -> tuple[str, ...]:
    """Return the words of an id, a name or a note in order, in small letters.

    Words end at capitals, digits and signs (``WoodenChair_01``: wooden, chair). Phrases that say something
    else (magnifying glass, Iron Man) are left out.
    """
    return tuple(part.lower() for part in _PART.findall(_PHRASES.sub(" ", text.replace("_", " "))))


def affirmed(text: str) -> str:
    """Return a note without what it denies: ``plastic, not iron`` says nothing of iron."""
    return _DENIED.sub(" ", text)


def is_word(word: str, of: str) -> bool:
    """Whether a word is another one or its plural."""
    return word in (of, f"{of}s", f"{of}es")
