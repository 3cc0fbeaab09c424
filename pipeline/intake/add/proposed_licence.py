"""Licences of what is added: by their SPDX identifiers, and with a name where they ask for one."""

from objectfolder.errors import InputError
from pipeline.intake.check.licence_rule import likely_spdx, spdx

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
    known = spdx(text)
    if known is not None:
        return known
    near = likely_spdx(text)
    hint = f"Did you mean {near}? " if near else ""
    raise InputError(where, f"{text!r} is no licence that SPDX knows", hint + REMEDY)


def must_name(licence: str) -> bool:
    """Whether a licence asks for its author to be named, as far as is known here."""
    return licence not in WITHOUT_NAMING
