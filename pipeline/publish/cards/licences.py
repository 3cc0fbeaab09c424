"""Licences as they are stated of objects, and what machines call them."""

from dataclasses import dataclass

from pipeline.intake.check.spdx import likely_spdx, spdx

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
    """A licence: its SPDX identifier where Hugging Face knows it, else what a table states, or nothing."""

    stated: str

    @classmethod
    def of(cls, text: str) -> "Licence":
        """Read what a table states: one licence written in two ways, as ``CC BY 4.0``, is one."""
        text = " ".join(text.split())
        if text.casefold() in NOT_STATED:
            return cls("")
        identifier = spdx(text) or likely_spdx(text)
        return cls(identifier if identifier in HUGGING_FACE else text)

    @property
    def spdx(self) -> str:
        """SPDX identifier; empty where none of these is stated."""
        return self.stated if self.stated in HUGGING_FACE else ""

    @property
    def label(self) -> str:
        """How people read it."""
        return self.stated or "no licence stated"

    @property
    def url(self) -> str:
        """Address of its text: SPDX's page, or the address that is itself the statement; else empty."""
        if self.spdx:
            return f"https://spdx.org/licenses/{self.spdx}.html"
        return self.stated if self.stated.startswith(("https://", "http://")) else ""

    @property
    def hugging_face(self) -> str:
        """Identifier in the front matter of a card on Hugging Face."""
        return HUGGING_FACE.get(self.stated, "other") if self.stated else "unknown"
