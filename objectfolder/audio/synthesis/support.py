"""What holds or carries a struck object: springs and dampers on its surface, to first order.

A support at x_p with stiffness k_p and damping d_p pushes back with -k_p u(x_p) - d_p u'(x_p). On modes of
unit modal mass that adds sum_p k_p phi_i(x_p) . phi_j(x_p) to the matrix of eigenvalues, and sum_p d_p
phi_i(x_p) . phi_j(x_p) to that of twice the decay rates. Its diagonal is the first order of perturbation
theory (J. W. S. Rayleigh, "The Theory of Sound", vol. 1, sections 90 and 102): mode shapes stay, each
eigenvalue grows by sum_p k_p |phi_i(x_p)|^2, each decay rate by half of sum_p d_p |phi_i(x_p)|^2.
"""

import reprlib
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from objectfolder.errors import QueryError
from objectfolder.query_values import point_rows, real, real_array
from objectfolder.renaming import renamed_keywords
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
SUPPORT_SAMPLES = 20_000  # of a surface, by area, from which a patch takes its points
MOST_POINTS = 64  # of a patch
# What lying on a table or in a hand adds to every decay rate, 1/s. Fitted beside the loss factors of the
# table of materials to modes of recorded impacts on ceramic, glass and wood (TDW 1.13.0; J. Traer,
# M. Cusimano and J. H. McDermott, Proc. DAFx 2019), whose shapes and supports nobody states: the largest
# geometric rms factor of the three is least. `bench.reality.sound` names the tables.
LYING_PER_S = 58.0
FASTEST_PER_S = 1e6
LYING = "lying"  # `Support.lying` by name


@dataclass(frozen=True)
class Support:
    """Springs and dampers between points of a surface and the ground.

    It holds while what is added to a mode is small (`strength`). The ground does not move. The object as a
    whole stays free: its bouncing on the springs, at tens of hertz, is left out, and so is rattling.

    Attributes
    ----------
    points : (s, 3) or (3,) metres, object frame, on the surface
    stiffness_n_m, damping_n_s_m : of each point, (s,), or one number that all points share evenly; along any
        direction alike
    rate_per_s : added to every decay rate: what a resistance in proportion to the mass does, spread over all
        of the body
    with_air : whether that rate has the air's share in it. A mode whose radiation is known then gains only
        what the rate is more than that

    Raises
    ------
    QueryError
        Points that are none, negative values, or not one a point.

    Examples
    --------
    >>> import objectfolder
    >>> bar = objectfolder.load("bar.safetensors")
    >>> fingers = Support([[0.0, 0.0, 0.004], [0.0, 0.0, -0.004]], damping_n_s_m=4.0)
    >>> free, held = (bar.strike([0.05, 0, 0.004], [0, 0, -1], 0.2, support=s)[0] for s in (None, fingers))
    >>> bool((held[-1000:] ** 2).sum() < (free[-1000:] ** 2).sum())
    True
    """

    points: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    stiffness_n_m: float | Floats = 0.0
    damping_n_s_m: float | Floats = 0.0
    rate_per_s: float = 0.0
    with_air: bool = False

    def __post_init__(self) -> None:
        rate = real("rate_per_s", self.rate_per_s, 0.0, FASTEST_PER_S, " 1/s")
        places = point_rows(self.points, "support", 0 if rate else 1)
        object.__setattr__(self, "points", places)
        object.__setattr__(self, "rate_per_s", rate)
        for name in ("stiffness_n_m", "damping_n_s_m"):
            value = real_array(name, getattr(self, name))
            if value.shape not in ((), (len(places),)) or not (value >= 0).all():
                remedy = "Give one number, or one a point, not negative."
                raise QueryError(name, f"{value.tolist()!r} for {len(places)} points", remedy)
            each = value if value.ndim else np.full(len(places), value / max(len(places), 1))
            object.__setattr__(self, name, each)

    @classmethod
    def lying(cls) -> "Support":
        """Lie on a table or in a hand, nobody knows how: every mode decays faster by `LYING_PER_S`.

        That was fitted to decays which have the air's share: a mode whose radiation is solved loses the
        larger of both beside what its material takes.

        Examples
        --------
        >>> import objectfolder
        >>> bar = objectfolder.load("bar.safetensors")
        >>> free, lying = (bar.strike([0, 0, 0.004], support=s)[0] for s in (None, "lying"))
        >>> bool((lying[-1000:] ** 2).sum() < (free[-1000:] ** 2).sum())
        True
        """
        return cls(rate_per_s=LYING_PER_S, with_air=True)

    @classmethod
    @renamed_keywords(centre="centre_m")
    def grip(cls, surface: Surface, centre_m: ArrayLike, radius_m: float, **total: float) -> "Support":
        """Hold the surface all over a ball, as a hand or a clamp does.

        Parameters
        ----------
        centre_m, radius_m
            Of the ball, metres, object frame.
        total
            ``stiffness_n_m`` and ``damping_n_s_m`` of the whole patch.

        Raises
        ------
        QueryError
            No surface in the ball.
        """
        points = surface.sample(SUPPORT_SAMPLES, 0).points
        middle = point_rows(np.asarray(centre_m), "centre_m")
        inside = np.linalg.norm(points - middle, axis=1) <= radius_m
        return cls._over(points[inside], f"no surface within {radius_m:g} m of {middle.tolist()}", total)

    @classmethod
    def stand(
        cls, surface: Surface, down: ArrayLike = (0.0, 0.0, -1.0), within_m: float = 5e-4, **total: float
    ) -> "Support":
        """Stand the object on its foot: all of the surface that is lowest, to `within_m` metres.

        Parameters
        ----------
        down
            (3,) where the ground is, object frame.
        total
            As for `grip`.
        """
        points = surface.sample(SUPPORT_SAMPLES, 0).points
        height = -points @ np.asarray(down, dtype=np.float64) / np.linalg.norm(down)
        lowest = height <= height.min() + within_m
        return cls._over(points[lowest], f"nothing lies lowest along {np.asarray(down).tolist()}", total)

    @classmethod
    def _over(cls, points: Floats, finding: str, total: dict[str, float]) -> "Support":
        if not len(points):
            raise QueryError("support", finding, "Give a place on the surface, metres.")
        # `total` names fields that are numbers; types cannot tell them from those that are arrays.
        return cls(points[:: max(1, len(points) // MOST_POINTS)], **total)  # type: ignore[arg-type]

    def added(self, shapes: Floats, radiated_per_s: Floats | None = None) -> tuple[Floats, Floats]:
        """Return what eigenvalues (rad^2/s^2) and decay rates (1/s) grow by, (modes,) each.

        Parameters
        ----------
        shapes
            (s, 3, modes) mass-normalised mode shapes at the points, kg^-1/2.
        radiated_per_s
            (modes,) what radiation has of the decay rates; None where it was not solved.
        """
        squared = (shapes**2).sum(axis=1)
        counted = radiated_per_s if self.with_air and radiated_per_s is not None else 0.0
        return (
            np.asarray(self.stiffness_n_m) @ squared,
            np.asarray(self.damping_n_s_m) @ squared / 2 + np.maximum(self.rate_per_s - counted, 0.0),
        )

    def strength(self, shapes: Floats, eigenvalues: Floats) -> Floats:
        """Return what the support adds over what is there, (modes,): to an eigenvalue or, doubled, to w.

        First order has errors of the order of its square, and of what modes of nearly equal frequency do
        together. Of 0.1 at most it is right to a few cents and a few per cent of the decay.
        """
        stiffer, faster = self.added(shapes)
        return np.asarray(np.maximum(stiffer / eigenvalues, 2 * faster / np.sqrt(eigenvalues)))


def named_support(support: Support | str | None) -> Support | None:
    """Return `Support.lying` for its name, and a support or None as it is.

    Raises
    ------
    QueryError
        Anything else.
    """
    if isinstance(support, str) and support == LYING:
        return Support.lying()
    if not isinstance(support, Support | None):
        raise QueryError("support", reprlib.repr(support), f"Give a `Support`, {LYING!r} or None.")
    return support
