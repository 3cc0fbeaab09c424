"""Task of stage `touches`: what the sensor feels."""

from objectfolder.making.touches.record import simulate_touches
from objectfolder.products.store import Product, read_product
from objectfolder.surface.textured_mesh import textured_mesh_of
from objectfolder.touch.sensor.sensor import Sensor
from pipeline.dataset.task import Request


def press_sensor(request: Request) -> Product:
    """Press the sensor of the data set all over one object."""
    surface = textured_mesh_of(read_product(request.inputs["objects"])).surface
    asked = dict(request.parameters["touch"])
    sensor = Sensor.from_dict(asked.pop("sensor"))
    return simulate_touches(surface, sensor, **asked, seed=request.seed)
