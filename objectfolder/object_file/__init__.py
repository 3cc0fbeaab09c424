"""One object in one file: what it looks, sounds and feels like."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.object_file.object_file import ObjectFile
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "object_file": ["ObjectFile"],
        },
        {"objectfolder.making": ["encode_object"]},
    )

__all__ = ["ObjectFile"]
