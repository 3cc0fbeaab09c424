"""One object in one file: what it looks, sounds and feels like."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.object_file.encoding import encode_object
    from objectfolder.object_file.object_file import ObjectFile
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "encoding": ["encode_object"],
            "object_file": ["ObjectFile"],
        },
    )

__all__ = ["ObjectFile", "encode_object"]
