"""Samples of truth and of Object Files for PyTorch, and products in xarray."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.dataset.exporting import export_samples
    from objectfolder.dataset.labelled import open_xarray
    from objectfolder.dataset.samples import ObjectSamples
    from objectfolder.dataset.tensors import ObjectBatches, ObjectFolderDataset
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "exporting": ["export_samples"],
            "labelled": ["open_xarray"],
            "samples": ["ObjectSamples"],
            "tensors": ["ObjectBatches", "ObjectFolderDataset"],
        },
    )

__all__ = ["ObjectBatches", "ObjectFolderDataset", "ObjectSamples", "export_samples", "open_xarray"]
