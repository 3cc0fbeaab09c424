"""Object Files resident on a device, asked in all three senses."""

from collections.abc import Sequence
from functools import cached_property

from objectfolder.batch.sight import SightBatch
from objectfolder.batch.sound import SoundBatch
from objectfolder.batch.targets import checked_device, torch
from objectfolder.batch.touch import TouchBatch
from objectfolder.object_file import ObjectFile
from objectfolder.object_file.shared_sensor import shared_sensor
from objectfolder.touch.sensor.sensor import Sensor


class Batch:
    """Object Files on a device; each sense is uploaded at its first query.

    Parameters
    ----------
    files
        The objects; queries name them by their places in this sequence.
    device
        ``"cuda"``, or ``"cpu"`` for the same answers from loops on one core.
    sensor
        What presses; the one that the files were made with if None.
    precision
        Of touched pixels, ``"single"`` or ``"double"``.

    Raises
    ------
    QueryError
        A device that is not there.

    Examples
    --------
    >>> import objectfolder
    >>> from objectfolder.batch import Batch
    >>> bar = objectfolder.load("bar.safetensors")
    >>> batch = Batch([bar], device="cpu")
    >>> points, normals = bar.sample_contacts(2, seed=0)
    >>> batch.touch.press(0, points).rgb.shape, batch.sound.strike(0, points, -normals, 0.1).shape
    (torch.Size([2, 160, 120, 3]), torch.Size([2, 4410]))
    """

    def __init__(
        self,
        files: Sequence[ObjectFile],
        device: str | torch.device = "cuda",
        *,
        sensor: Sensor | None = None,
        precision: str = "single",
    ) -> None:
        self.files = list(files)
        self.device = checked_device(device)
        self._sensor, self._precision = sensor, precision

    @cached_property
    def touch(self) -> TouchBatch:
        """Touches; see `TouchBatch.press` and `TouchBatch.see`.

        Raises
        ------
        QueryError
            Files made with different sensors, and none named.
        """
        nets = [file.touch.net for file in self.files]
        sensor = self._sensor or shared_sensor({str(index): file for index, file in enumerate(self.files)})
        patches = [net._patches for net in nets]
        return TouchBatch(patches, sensor, nets[0].samples, self.device, self._precision)

    @cached_property
    def sound(self) -> SoundBatch:
        """Strikes; see `SoundBatch.strike`."""
        return SoundBatch([file.sound for file in self.files], self.device)

    @cached_property
    def sight(self) -> SightBatch:
        """Views; see `SightBatch.render`."""
        return SightBatch([file.sight for file in self.files], self.device)
