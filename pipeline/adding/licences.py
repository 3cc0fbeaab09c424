"""Licences by their SPDX identifiers, so that programs and people read the same."""

import re

from objectfolder.errors import InputError

WITHOUT_NAMING = frozenset(("CC0-1.0", "0BSD", "Unlicense", "PDDL-1.0", "MIT-0"))
"""Licences that do not ask for the author to be named."""

REMEDY = (
    "Use an identifier of https://spdx.org/licenses, such as CC-BY-4.0 or CC0-1.0, or LicenseRef-NAME for "
    "another"
)


def licence_expression(text: str, where: str = "--licence") -> str:
    """Return an SPDX licence expression as SPDX writes it (``cc0-1.0`` is ``CC0-1.0``).

    Raises
    ------
    InputError
        It is none; the remedy names the likely one.
    """
    known = _canonical(text)
    if known is not None:
        return known
    near = _likely(text)
    hint = f"Did you mean {near}? " if near else ""
    raise InputError(where, f"{text!r} is no licence that SPDX knows", hint + REMEDY)


def must_name(licence: str) -> bool:
    """Whether a licence asks for its author to be named, as far as is known here."""
    return licence not in WITHOUT_NAMING


def _canonical(text: str) -> str | None:
    from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

    try:
        return str(canonicalize_license_expression(text))
    except InvalidLicenseExpression:
        return None


def _likely(text: str) -> str | None:
    """Of the common ways to write a licence, what SPDX calls it."""
    plain = re.sub(r"^creative\s*commons\b", "cc", text.strip().casefold())
    plain = re.sub(r"\b(licen[cs]e|international|public domain dedication|universal|v(?=\d))", " ", plain)
    plain = re.sub(r"\battribution\b", "by", plain)
    plain = re.sub(r"\bshare\s*alike\b", "sa", plain)
    plain = re.sub(r"\bnon-?\s*commercial\b", "nc", plain)
    joined = re.sub(r"[\s_/-]+", "-", plain).strip("-")
    joined = joined.replace("cc-0", "cc0")
    for candidate in (joined, f"{joined}-1.0", f"{joined}-2.0", f"{joined}-4.0"):
        known = _canonical(candidate)
        if known is not None:
            return known
    return None
