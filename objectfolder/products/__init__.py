"""Ground truth in files, and splits of objects."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.products.splits import object_split
    from objectfolder.products.store import Array, Product, read_product
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "splits": ["object_split"],
            "store": ["Array", "Product", "read_product"],
        },
    )

__all__ = ["Array", "Product", "object_split", "read_product"]
