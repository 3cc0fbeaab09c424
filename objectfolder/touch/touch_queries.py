"""What an Object File answers when a sensor is pressed against it."""

import functools
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.errors import QueryError
from objectfolder.forks import hold_forks
from objectfolder.query_values import LARGEST_SEED, MOST_SAMPLED, whole
from objectfolder.renaming import renamed_keywords
from objectfolder.surface.contact_surface import ContactSurface
from objectfolder.touch.presses.touches import Press, Reach, Touches
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.touchnet import TouchNet

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
MOST_ATTEMPTS = 100
UNITS = {
    "depth": "depth_m",
    "tilt": "tilt_deg",
    "azimuth": "azimuth_deg",
    "roll": "roll_deg",
    "force": "force_n",
}


def _of_net(
    method: Callable[Concatenate["TouchQueries", ArrayLike, Parameters], Result],
) -> Callable[Concatenate["TouchQueries", ArrayLike, Parameters], Result]:
    """Pass a `Press` on to the net, as ``ObjectFile.touch`` was the net before, with a warning."""

    @functools.wraps(method)
    def call(
        touch: "TouchQueries", points: ArrayLike, *arguments: Parameters.args, **keywords: Parameters.kwargs
    ) -> Result:
        if not (arguments and isinstance(arguments[0], Press)) and "asked" not in keywords:
            return method(touch, points, *arguments, **keywords)
        _warn_of_net(method.__name__, stacklevel=4)
        return cast("Result", getattr(touch.net, method.__name__)(points, *arguments, **keywords))

    return call


def _warn_of_net(name: str, stacklevel: int) -> None:
    message = f"`touch.{name}` of the net is now `touch.net.{name}`; the old way goes with 0.3"
    warnings.warn(message, DeprecationWarning, stacklevel=stacklevel)


class TouchQueries:
    """Touches of an object: `ObjectFile.touch`.

    Parameters
    ----------
    net
        The encoder of touch.
    contacts
        The surface, metres, that contacts are brought onto.
    """

    def __init__(self, net: TouchNet, contacts: ContactSurface) -> None:
        self.net = net
        self.contacts = contacts

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            # `ObjectFile.touch` was the net.
            if name not in ("surface", "samples", "contact", "tensors", "metadata", "from_tensors"):
                raise AttributeError(f"'TouchQueries' object has no attribute {name!r}")
            _warn_of_net(name, stacklevel=3)
            return getattr(self.net, name)

    @property
    def sensor(self) -> Sensor:
        """The sensor that is pressed."""
        return self.net.sensor

    @property
    def no_contact(self) -> NDArray[np.uint8]:
        """Image (height, width, 3) of the untouched gel."""
        image: NDArray[np.uint8] = self.net.no_contact
        return image

    @renamed_keywords(**UNITS)
    @_of_net
    @hold_forks
    def press(
        self,
        points: ArrayLike,
        depth_m: float | NDArray[np.floating[Any]] | None = None,
        tilt_deg: float | NDArray[np.floating[Any]] = 0.0,
        azimuth_deg: float | NDArray[np.floating[Any]] = 0.0,
        *,
        roll_deg: float | NDArray[np.floating[Any]] = 0.0,
        force_n: float | NDArray[np.floating[Any]] | None = None,
        contact: str | None = None,
        resolution: int | tuple[int, int] | None = None,
        background: NDArray[np.uint8] | None = None,
        noise_seed: int | Sequence[int] | None = None,
    ) -> Touches:
        """Press the sensor along the surface normal.

        Parameters
        ----------
        points
            (3,) or (n, 3) contacts, metres, within `surface_tolerance_m` of the surface.
        depth_m
            How far into the gel, metres; a millimetre where neither a depth nor a force is given.
        tilt_deg, azimuth_deg
            Inclination of the sensor from the normal and its direction, degrees.
        roll_deg
            Turn of the sensor about its own axis, degrees, the image's right towards its top; `reach` finds
            rolls at which it fits.
        force_n
            Instead of a depth: newtons along the sensor's axis, under the elastic model.
        contact
            ``"rigid"``, as TACTO, or ``"elastic"``; by default the file's own, and elastic with a force.
        resolution
            Height and width of the images in pixels, or one number for both; by default the sensor's.
        background
            (height, width, 3) uint8, a real sensor's untouched image to lay the touches over.
        noise_seed
            Seed of the sensor's noise, or (n,) one a touch, each then as it is alone; by default no noise.

        Raises
        ------
        QueryError
            A contact off the surface (with its distance), or a depth, force, size or model that the
            sensor cannot answer.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, _ = bar.sample_contacts(2, seed=0)
        >>> touches = bar.press(points, depth_m=0.001)
        >>> touches.rgb.shape, touches.penetration_m.tolist()
        ((2, 160, 120, 3), [0.001, 0.001])
        """
        return self.net.press(
            self.contacts.project(points).points,
            Press(depth_m, force_n, tilt_deg, azimuth_deg, roll_deg, contact, self.net.samples),
            resolution=resolution,
            background=background,
            noise_seed=noise_seed,
        )

    @renamed_keywords(**UNITS)
    @_of_net
    @hold_forks
    def reach(
        self,
        points: ArrayLike,
        depth_m: float | NDArray[np.floating[Any]] | None = None,
        tilt_deg: float | NDArray[np.floating[Any]] = 0.0,
        azimuth_deg: float | NDArray[np.floating[Any]] = 0.0,
        *,
        roll_deg: float | NDArray[np.floating[Any]] = 0.0,
        rolls: int = 24,
    ) -> Reach:
        """Find rolls of the sensor at which points can be pressed, under the rigid model and without images.

        Parameters
        ----------
        points, depth_m, tilt_deg, azimuth_deg, roll_deg
            As for `press`; the roll is the first that is tried.
        rolls
            How many are tried, evenly round a turn, 1 to 360.

        Returns
        -------
        Reach
            ``reachable`` (n, rolls), ``at_some_roll`` (n,) and ``best_roll_deg`` (n,).

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> reach = bar.reach([[0.0, 0.0, 0.004]])
        >>> reach.at_some_roll.tolist(), reach.best_roll_deg.tolist()
        ([True], [0.0])
        """
        press = Press(depth_m, None, tilt_deg, azimuth_deg, roll_deg)
        return self.net.reach(self.contacts.project(points).points, press, rolls)

    @renamed_keywords(count="n")
    @hold_forks
    def sample_contacts(
        self, n: int = 1, seed: int = 0, *, reachable: bool = True
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw contacts uniformly by area: points (n, 3) metres and outward unit normals (n, 3).

        Parameters
        ----------
        n, seed
            How many, and the seed of the draw.
        reachable
            Only contacts at which the sensor can be pressed a millimetre deep along the normal; each is
            tried. False draws anywhere on the surface, also where no sensor fits, as deep inside of a mug:
            `Touches.reachable` of a press says so.

        Raises
        ------
        QueryError
            Hardly any of the surface can be reached.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> points, normals = bar.sample_contacts(20)
        >>> bool(bar.press(points).reachable.all())
        True
        >>> points, normals = bar.sample_contacts(1000, reachable=False)
        >>> points.shape, float(abs(points).max(axis=0)[0].round(2))
        ((1000, 3), 0.06)
        """
        count, seed = whole("n", n, 0, MOST_SAMPLED), whole("seed", seed, 0, LARGEST_SEED)
        samples = self.contacts.surface.sample(count, seed)
        if not reachable or not count:
            return samples.points, samples.normals
        points, normals = np.zeros((0, 3)), np.zeros((0, 3))
        for attempt in range(1, MOST_ATTEMPTS + 1):
            fits = self.reach(samples.points, rolls=1).at_some_roll
            points = np.concatenate([points, samples.points[fits]])
            normals = np.concatenate([normals, samples.normals[fits]])
            if len(points) >= count:
                return points[:count], normals[:count]
            again = np.random.SeedSequence([seed, attempt]).generate_state(1)
            samples = self.contacts.surface.sample(count, int(again[0]))
        finding = f"{len(points)} of {MOST_ATTEMPTS * count} contacts drawn can be reached"
        raise QueryError("reachable", finding, "Draw contacts anywhere, or ask for more of them.")
