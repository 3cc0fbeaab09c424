"""Licences as they are stated of objects, and what machines call them."""

from dataclasses import dataclass

from pipeline.intake.check.licence_rule import likely_spdx, spdx

# SPDX identifier to the identifier that Hugging Face knows; every other licence is "other" there.
HUGGING_FACE = {
    name: name.lower()
    for name in (
        "CC0-1.0", "CC-BY-2.0", "CC-BY-2.5", "CC-BY-3.0", "CC-BY-4.0", "CC-BY-SA-3.0", "CC-BY-SA-4.0",
        "CC-BY-NC-2.0", "CC-BY-NC-3.0", "CC-BY-NC-4.0", "CC-BY-ND-4.0", "CC-BY-NC-SA-2.0", "CC-BY-NC-SA-3.0",
        "CC-BY-NC-SA-4.0", "CC-BY-NC-ND-3.0", "CC-BY-NC-ND-4.0", "Apache-2.0", "MIT", "BSD-2-Clause",
        "BSD-3-Clause", "Unlicense",
    )
} | {"ODbL-1.0": "odbl", "ODC-By-1.0": "odc-by", "PDDL-1.0": "pddl"}  # fmt: skip
# What tables say where nobody stated a licence; compared without case.
NOT_STATED = frozenset({"", "not stated", "unknown", "none", "n/a", "?"})


@dataclass(frozen=True)
class Licence:
    """One licence as it is stated.

    Parameters
    ----------
    stated
        The text of the table of objects, or the SPDX identifier that it means; empty where none is stated.
    """

    stated: str

    @classmethod
    def of(cls, text: str) -> "Licence":
        """Read what a table states: one licence written in two ways is one."""
        text = " ".join(text.split())
        read = cls("" if text.casefold() in NOT_STATED else text)
        return cls(read.spdx or read.stated)

    @property
    def spdx(self) -> str:
        """SPDX identifier, also where it is written ``CC BY 4.0``; empty where none of these is stated."""
        found = spdx(self.stated) or (self.stated and likely_spdx(self.stated))
        return found if found in HUGGING_FACE else ""

    @property
    def label(self) -> str:
        """How people read it."""
        return self.spdx or self.stated or "no licence stated"

    @property
    def url(self) -> str:
        """Address of its text: SPDX's page, or the address that is itself the statement; else empty."""
        if self.spdx:
            return f"https://spdx.org/licenses/{self.spdx}.html"
        return self.stated if self.stated.startswith(("https://", "http://")) else ""

    @property
    def hugging_face(self) -> str:
        """Identifier in the front matter of a card on Hugging Face."""
        if not self.stated:
            return "unknown"
        return HUGGING_FACE.get(self.spdx, "other")
