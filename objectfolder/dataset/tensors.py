"""Samples as tensors of PyTorch, and batches of few objects each."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from objectfolder.dataset.order import batches_of_few_objects
from objectfolder.dataset.samples import ObjectSamples
from objectfolder.errors import InputError
from objectfolder.extras import needs_extra

with needs_extra("dataset"):
    import torch
    from torch.utils.data import Dataset, Sampler


class ObjectFolderDataset(ObjectSamples, Dataset[dict[str, Any]]):
    """Samples of one sense, of the ground truth or of the Object Files of the same queries.

    Every sample is a dict. All have ``object_id`` (str) and ``query`` (int: the row in the product). Numbers
    are tensors, float32 unless said otherwise, in the object frame:

    - *vision*: ``image`` (3, h, w) sRGB on white in [0, 1], ``camera_to_object`` (4, 4) m,
      ``light_position_m`` (3,); with `passes` also ``depth_m`` (h, w) along the camera's axis, infinity where
      the object is not, and ``mask`` (h, w) bool.
    - *audio*: ``sound`` (samples,) m/s, along the normal where it is struck, zeros for a silent object;
      ``point_m`` (3,), ``impulse_n_s`` (3,) N s: 1 along x, y and z in turn.
    - *touch*: ``image`` (3, h, w) in [0, 1], ``depth_m`` (h, w) in the gel, ``mask`` (h, w) bool,
      ``sensor_to_object`` (4, 4) m, ``reachable`` bool; ``point_m`` (3,), ``press_depth_m``, ``tilt_deg``,
      ``azimuth_deg``.

    Left out by default is what teaches nothing: objects without an audible mode, whose sounds are silence (a
    die), and touches of places that the sensor cannot reach (deep inside of a mug). `all_queries` has them.

    Nothing that is open is pickled or shared with a forked process: `DataLoader` workers of any kind may use
    it. A sample depends on its index alone. Those of a batch that are of one object are answered together,
    which is faster; see `ObjectBatches`.

    Parameters
    ----------
    root_or_files
        Root of a data set (``data/views`` and so on lie in it), or Object Files. Files alone have no truth:
        `source` must be ``"object_file"``, and `queries` of each are drawn by `seed`.
    sense
        ``"vision"``, ``"audio"`` or ``"touch"``.
    split
        ``"training"`` or ``"held_out"``: the queries that the ground truth keeps for each; for files alone
        other draws.
    source
        ``"truth"`` or ``"object_file"``.
    objects
        Ids, in this order; all of the data set by id if None.
    object_split
        Only objects of this split: ``"train"``, ``"validation"`` or ``"test"``, see
        `objectfolder.products.splits`. It needs ``data/records.json``, which lies in the git repository of a
        data set.
    queries, seed
        For files alone.
    duration_s, sample_rate_hz
        Of sounds.
    resolution
        Pixels a side of views, for files alone; otherwise the truth's.
    sub_rays
        Of views of Object Files, as for `ObjectFile.render`: 4 is two to three times as fast as the default
        64, and 2 to 4 dB farther from the truth.
    passes
        Whether views come with depth and mask.
    all_queries
        Also silent objects, and touches that cannot be.
    open_objects
        How many products and Object Files a process keeps open: memory against reading again. A product of
        modes takes its mode shapes with it, 3 to 15 MB.

    Raises
    ------
    InputError
        A sense, split, source or object that there is not, or no truth where it is asked for.
    FormatError
        A damaged product.

    Examples
    --------
    >>> samples = ObjectFolderDataset("bar.safetensors", "touch", source="object_file", queries=3)
    >>> len(samples), tuple(samples[0]["image"].shape)
    (3, (3, 160, 120))
    """

    def __getitems__(self, indices: Sequence[int]) -> list[dict[str, Any]]:
        """Return samples, those of one object answered together; `DataLoader` asks so for a batch."""
        return [
            {
                key: torch.from_numpy(value) if isinstance(value, np.ndarray) else value
                for key, value in sample.items()
            }
            for sample in super().__getitems__(indices)
        ]


class ObjectBatches(Sampler[list[int]]):
    """Batches of samples in random order that are of few objects each; a `batch_sampler` of `DataLoader`.

    Every epoch has every sample once. Its objects are shuffled and taken a few at a time, and the samples of
    these are shuffled. So products and Object Files are opened once an epoch, however many objects there are,
    and a batch asks each of its objects for several samples at once.

    Parameters
    ----------
    samples
        A data set.
    batch_size
        Samples a batch; the last has the rest.
    together
        Objects at a time, at most the `open_objects` of the data set.
    seed
        Of the order. Each epoch has another one.

    Examples
    --------
    >>> from objectfolder.dataset import ObjectFolderDataset
    >>> samples = ObjectFolderDataset("bar.safetensors", "touch", source="object_file", queries=5)
    >>> [len(batch) for batch in ObjectBatches(samples, 2)]
    [2, 2, 1]
    """

    def __init__(self, samples: ObjectSamples, batch_size: int, *, together: int = 4, seed: int = 0) -> None:
        for name, value in (("batch_size", batch_size), ("together", together)):
            if value < 1:
                raise InputError(name, f"{value}", "Give 1 or more.")
        self._samples, self._size, self._together, self._seed = samples, batch_size, together, seed
        self._epoch = 0

    def __len__(self) -> int:
        return -(-len(self._samples) // self._size)

    def __iter__(self) -> Iterator[list[int]]:
        random = np.random.default_rng([self._seed, self._epoch])
        self._epoch += 1
        yield from batches_of_few_objects(self._samples.ranges(), self._size, self._together, random)
