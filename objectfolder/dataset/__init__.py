"""Samples of truth and of Object Files for PyTorch, and products in xarray."""

from objectfolder.dataset.batches import ObjectBatches
from objectfolder.dataset.exporting import export_samples
from objectfolder.dataset.labelled import open_xarray
from objectfolder.dataset.samples import ObjectFolderDataset

__all__ = ["ObjectBatches", "ObjectFolderDataset", "export_samples", "open_xarray"]
