"""How close an Object File is to its ground truth."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.fidelity.verification import Verification, verify_object
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "verification": ["Verification", "verify_object"],
        },
    )

__all__ = ["Verification", "verify_object"]
