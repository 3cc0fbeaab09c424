"""Object Files on a graphics processor: thousands of queries of all senses at once, as tensors there.

Needs the extra ``gpu``: torch and numba-cuda. The device ``"cpu"`` gives the same answers without a GPU.
"""

from objectfolder.batch.batch import Batch
from objectfolder.batch.shear import BatchMarkers, BatchShear
from objectfolder.batch.sight import SightBatch
from objectfolder.batch.sound import SoundBatch
from objectfolder.batch.touch import BatchTouches, TouchBatch, TouchImages
from objectfolder.batch.world_touch import WorldTouch

__all__ = [
    "Batch", "BatchMarkers", "BatchShear", "BatchTouches", "SightBatch", "SoundBatch", "TouchBatch",
    "TouchImages", "WorldTouch",
]  # fmt: skip
