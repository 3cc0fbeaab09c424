"""Samples of truth and of Object Files for PyTorch, and products in xarray."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.dataset.batches import ObjectBatches
    from objectfolder.dataset.exporting import export_samples
    from objectfolder.dataset.labelled import open_xarray
    from objectfolder.dataset.samples import ObjectFolderDataset
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "batches": ["ObjectBatches"],
            "exporting": ["export_samples"],
            "labelled": ["open_xarray"],
            "samples": ["ObjectFolderDataset"],
        },
    )

__all__ = ["ObjectBatches", "ObjectFolderDataset", "export_samples", "open_xarray"]
