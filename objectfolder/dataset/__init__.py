"""Samples of truth and of Object Files for PyTorch, and products in xarray."""

from objectfolder.dataset.batches import ObjectBatches
from objectfolder.dataset.labelled import open_xarray
from objectfolder.dataset.samples import ObjectFolderDataset

__all__ = ["ObjectBatches", "ObjectFolderDataset", "open_xarray"]
