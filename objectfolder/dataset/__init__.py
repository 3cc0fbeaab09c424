"""Samples of truth and of Object Files for PyTorch, and products in xarray."""

from objectfolder.dataset.labelled import open_xarray
from objectfolder.dataset.samples import ObjectFolderDataset

__all__ = ["ObjectFolderDataset", "open_xarray"]
