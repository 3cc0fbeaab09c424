"""The sensor that presses several Object Files where none is named: the one that they were made with."""

from collections.abc import Mapping

from objectfolder.errors import QueryError
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.touch.sensor.sensor import Sensor


def shared_sensor(files: Mapping[str, ObjectFile]) -> Sensor:
    """Return the sensor that all of some Object Files were made with.

    Parameters
    ----------
    files
        One at least, by the names that an error calls them by.

    Raises
    ------
    QueryError
        Two of them were made with different sensors.

    Examples
    --------
    >>> import objectfolder
    >>> shared_sensor({"bar": objectfolder.load("bar.safetensors")}).gel_thickness_m
    0.004
    """
    (first, file), *rest = files.items()
    for name, peer in rest:
        if peer.touch.sensor.to_dict() != file.touch.sensor.to_dict():
            finding = f"{first!r} was made with another sensor than {name!r}"
            raise QueryError("sensor", finding, "Say which one presses.")
    return file.touch.sensor
