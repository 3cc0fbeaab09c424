"""Licences by their SPDX identifiers."""

import re

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

COMMON_NAMES = {
    "creative commons": "cc", "attribution": "by", "share ?alike": "sa", "non-? ?commercial": "nc",
    "no-? ?derivatives": "nd", r"universal|international|public domain|licen[cs]e|zero|[(),]": " ",
}  # fmt: skip
"""Parts of names of Creative Commons licences, as patterns, and those of their identifiers."""


def spdx(licence: str) -> str | None:
    """Return a licence expression as SPDX writes it; None for an invalid one."""
    try:
        return str(canonicalize_license_expression(licence))
    except InvalidLicenseExpression:
        return None


def likely_spdx(licence: str) -> str | None:
    """Return what a common way to write a Creative Commons licence means; None where it means none."""
    text = licence.lower()
    for pattern, part in COMMON_NAMES.items():
        text = re.sub(pattern, part, text)
    text = "-".join(re.split(r"[\s-]+", text.strip()))
    if not re.search(r"\d\.\d", text):
        text += "-1.0" if text == "cc0" else "-4.0"
    return spdx(text)
