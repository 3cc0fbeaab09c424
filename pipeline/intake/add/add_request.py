"""The description of an object to add to a table; light to import."""

from dataclasses import dataclass

from pipeline.dataset.described_object import DescribedObject


@dataclass(frozen=True, kw_only=True)
class AddRequest(DescribedObject):
    """An object to add.

    Parameters
    ----------
    licence
        SPDX identifier, such as CC-BY-4.0 or CC0-1.0
    attribution
        whom to name (needed except for CC0-1.0 and similar licences)
    """

    licence: str
    attribution: str | None = None
