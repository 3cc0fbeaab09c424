"""The calibration of one's own sensor from photographs of a ball of known size pressed into its gel.

Needs SciPy.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.sensor.ball_prints import Print, find_prints
from objectfolder.making.sensor.calibration import (
    NormalEquations,
    ball_image,
    ball_indentation,
    ball_pixels,
    gel_pixels,
    normal_equations,
)
from objectfolder.touch.sensor.camera import ray_grid
from objectfolder.touch.sensor.gel import gel_sag
from objectfolder.touch.sensor.indentation_response import IndentationResponse, ResponseField, ResponseFit
from objectfolder.touch.sensor.magnification import pixels_per_metre
from objectfolder.touch.sensor.marker_tracking import Tracking, track_markers, without_dots
from objectfolder.touch.sensor.sensor import Sensor

SHAPE = (13, 24)
# Weights among which the photographs that are fitted choose, by leaving some out in turn.
SMOOTHNESS = (1e-3, 1e-2, 1e-1, 1.0, 10.0)
UNIFORMITY = (0.0, 1e-3, 1e-2, 1e-1, 1.0, 10.0)
# Of how the untouched gel depends on the place: all of it, as changes are alike, or none, as values are.
SHARES = (1.0, 0.5, 0.0)
# Of a response, likewise: its patterns' roughness, and how much more their dependence on the place costs; and
# of a blur on the gel, metres.
ROUGHNESS = (1e-2, 1e-1, 1.0, 10.0)
UNEVENNESS = (1.0, 30.0)
BLURS_M = (0.0, 1e-4, 2e-4, 3e-4, 4e-4)
# Of the contact's radius: what lies farther from every mark is untouched gel.
UNTOUCHED = 2.2
LEAST_PRINTS = 3
# Of few photographs each is left out by itself.
FOLDS, FEW = 3, 6
# Of the ball's radius in a photograph.
LEAST_BALL_PIXELS = 8.0
ALIKE_PIXELS = 4.0


@dataclass(frozen=True, eq=False)
class OwnCalibration:
    """A sensor with its table, how it was found, and how far it is from the photographs.

    Parameters
    ----------
    sensor
        With a photometric table, an indentation response and a blur, fitted to all photographs with a circle.
    untouched
        (height, width, 3) uint8: what it shows in this session when nothing touches it.
    prints
        Of each photograph, or why it has none.
    uncertainty
        (slopes, directions) grey levels: expected error of the table's nodes, at the middle of the gel. Where
        the ball showed their slopes it is in the mean that of the photographs held out.
    shown_deg
        The steepest slope that a ball showed, degrees.
    held_out
        PSNR (m,) in the contact circle of every second photograph, by what is fitted to the others.
    held_out_around
        (m,) the same within `UNTOUCHED` times the circle's radius.
    nothing, mean_patch
        (m,) of the same: by the untouched picture, and by the mean of the others' patches.
    repeatability
        (k,) of pairs of photographs of nearly one press.
    smoothness, uniformity, share
        Weights of the table's smoothness, and of its slopes' being alike at all places: few photographs
        choose a high one. What is alike is the change of the untouched gel (a share of 1), or the value (0).
    markers
        The grid of dots that the untouched picture shows, and where they are in the photographs; None where
        it shows none. What they hide is filled from what is about them; no table is fitted to it, and no
        figure counts it.
    """

    sensor: Sensor
    untouched: np.ndarray
    prints: list[Print | str]
    uncertainty: np.ndarray
    shown_deg: float
    held_out: np.ndarray
    held_out_around: np.ndarray
    nothing: np.ndarray
    mean_patch: np.ndarray
    repeatability: np.ndarray
    smoothness: float
    uniformity: float
    share: float
    markers: Tracking | None


def calibrate(
    photographs: np.ndarray, untouched: np.ndarray, sensor: Sensor, ball_m: float
) -> OwnCalibration:
    """Calibrate a sensor by photographs of a ball pressed into its gel.

    Parameters
    ----------
    photographs
        (n, height, width, 3) uint8.
    untouched
        (height, width, 3) uint8: the sensor when nothing touches it. Smooth differences of light between it
        and the photographs are found from them.
    sensor
        What it is like otherwise: camera, gel, shadows; of the size of the photographs.
    ball_m
        Radius of the ball, metres.

    Raises
    ------
    InputError
        Fewer than `LEAST_PRINTS` photographs with a circle, or a ball larger than the gel or the picture, or
        too small in it.

    Examples
    --------
    >>> import numpy as np
    >>> from objectfolder.errors import InputError
    >>> from objectfolder.making import calibrate
    >>> from objectfolder.touch import read_sensor
    >>> sensor = read_sensor("digit").at_resolution(64, 48)
    >>> grey = np.full((64, 48, 3), 90, np.uint8)
    >>> try:
    ...     calibrate(grey[None], grey, sensor, ball_m=0.00235)
    ... except InputError as error:
    ...     print(error)
    photographs: 0 of 1 photographs show a contact circle; ... At least 3 are needed.
    """
    if 2 * ball_m > min(sensor.gel_width_m, sensor.gel_height_m):
        sides = f"{sensor.gel_width_m * 1e3:g} x {sensor.gel_height_m * 1e3:g} mm"
        raise InputError(
            "ball", f"{2e3 * ball_m:g} mm is larger than the gel of {sides}", "Use a smaller one."
        )
    try:
        ray_grid(sensor, 1)
    except ValueError as error:
        raise InputError("sensor", str(error), "Give its magnification, or another sensor.") from error
    scale = pixels_per_metre(sensor)
    if not LEAST_BALL_PIXELS <= ball_m * scale <= max(sensor.image_height, sensor.image_width):
        size = f"{sensor.image_width} x {sensor.image_height}"
        finding = f"{2e3 * ball_m:g} mm are {2 * ball_m * scale:.3g} pixels of pictures of {size}"
        raise InputError("ball", finding, "Give its diameter in millimetres, or the right magnification.")
    markers = track_markers(photographs, untouched, sensor)
    if markers is not None:
        untouched = without_dots(untouched, markers.rest_hidden)
        pairs = zip(photographs, markers.hidden, strict=True)
        photographs = np.stack([without_dots(picture, hidden) for picture, hidden in pairs])
    unpressed = _session_light(photographs, untouched, [])
    prints = find_prints(photographs - unpressed, ball_m * scale)
    unpressed = _session_light(photographs, untouched, prints)
    prints = find_prints(photographs - unpressed, ball_m * scale)
    if markers is not None:
        prints = [markers.fault(index) or circle for index, circle in enumerate(prints)]
    marked = [index for index, mark in enumerate(prints) if isinstance(mark, Print)]
    if len(marked) < LEAST_PRINTS:
        faults = [circle for circle in prints if isinstance(circle, str)]
        reason = f"; the first that does not: {faults[0]}" if faults else ""
        finding = f"{len(marked)} of {len(prints)} photographs show a contact circle{reason}"
        raise InputError("photographs", finding, f"At least {LEAST_PRINTS} are needed.")
    unmarked = np.clip(np.rint(unpressed), 0, 255).astype(np.uint8)
    shown = np.ones(photographs.shape[:3], dtype=bool) if markers is None else ~markers.hidden
    fit = _Fit(photographs, shown, unpressed, unmarked, sensor, ball_m, prints)
    held_out, others = marked[1::2], marked[::2]
    weights = fit.weights(others)
    held = fit.response_weights(others, weights)
    changes = fit.changes(others, held_out, weights)
    pictures = fit.round_errors(held_out, changes, fit.response.solve(others, *held[:2]), held[2])
    errors = [picture[fit.disc(index)] for index, picture in zip(held_out, pictures, strict=True)]
    around = [picture[fit.disc(index, UNTOUCHED)] for index, picture in zip(held_out, pictures, strict=True)]
    whole = fit.equations(marked)
    table = whole.solve(*weights)
    shown_deg = max(np.degrees(np.arcsin(fit.circle(index).radius / (ball_m * scale))) for index in marked)
    spread = whole.spread(*weights)
    rows = np.linspace(0, 90, SHAPE[0]) <= shown_deg
    level = np.sqrt(np.mean([_square(part) for part in errors]))
    return OwnCalibration(
        replace(
            _plain(sensor),
            photometric_table=table,
            indentation_response=fit.response.solve(marked, *held[:2]),
            background_blur_m=held[2],
            marker_grid=None if markers is None else markers.grid,
        ),
        unmarked,
        prints,
        spread * level / np.sqrt((spread[rows] ** 2).mean()),
        float(shown_deg),
        _psnr(errors),
        _psnr(around),
        _psnr([(photographs[index] - unpressed)[fit.disc(index)] for index in held_out]),
        _psnr(_from_mean_patch(photographs, fit, others, held_out)),
        _psnr(_between_alike(photographs, fit, marked)),
        *weights,
        markers,
    )


def _session_light(
    photographs: np.ndarray, untouched: np.ndarray, prints: Sequence[Print | str]
) -> np.ndarray:
    """What the sensor shows untouched in the photographs' own light (height, width, 3).

    The median of what no mark is near, where three photographs show that of every pixel. Else the untouched
    picture and a quadratic polynomial of the place, fitted to what no mark is near.
    """
    shape = photographs.shape[1:3]
    circles = [circle for circle in prints if isinstance(circle, Print)]
    clear = [
        ~circle.disc(shape, UNTOUCHED) if isinstance(circle, Print) else np.full(shape, not prints)
        for circle in prints or [""] * len(photographs)
    ]
    if circles and (np.sum(clear, axis=0) >= LEAST_PRINTS).all():
        hidden = np.where(np.array(clear)[..., None], photographs.astype(np.float32), np.nan)
        return np.asarray(np.nanmedian(hidden, axis=0), dtype=np.float64)
    down, across = (2 * part / length - 1 for part, length in zip(np.indices(shape), shape, strict=True))
    terms = np.stack([np.ones(shape), across, down, across**2, across * down, down**2], axis=-1)
    samples = np.concatenate([terms[unmarked][::13] for unmarked in clear])
    change = np.concatenate(
        [
            (photo.astype(np.float64) - untouched)[unmarked][::13]
            for photo, unmarked in zip(photographs, clear, strict=True)
        ]
    )
    weight = np.ones(len(samples))
    # What a mark changes counts little: least absolute errors, by weights.
    for _ in range(8):
        root = np.sqrt(weight)[:, None]
        fitted = np.linalg.lstsq(samples * root, change * root, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(change - samples @ fitted).sum(axis=1), 3.0)
    return np.asarray(untouched + terms @ fitted)


def _plain(sensor: Sensor) -> Sensor:
    """The sensor without lights and shadows, and whose touches are laid over a background as they are."""
    laid = {"background_gain": 1.0, "background_blur_pixels": 1, "background_blur_m": 0.0}
    dark = dict.fromkeys(("light_positions_m", "light_colours", "shadow_positions_m", "shadow_shares"), ())
    return replace(sensor, indentation_response=None, marker_grid=None, **dark, **laid)  # type: ignore[arg-type]


class _Fit:
    """Tables of some of the photographs, and their errors on others."""

    def __init__(
        self, photographs: np.ndarray, shown: np.ndarray, unpressed: np.ndarray, untouched: np.ndarray,
        sensor: Sensor, ball_m: float, prints: Sequence[Print | str],
    ) -> None:  # fmt: skip
        self._photographs, self._sensor, self._ball, self._prints = photographs, sensor, ball_m, prints
        self._shown = shown
        self._gel = normal_equations(gel_pixels(sensor, untouched)[:, ::4], SHAPE)
        self._of: dict[int, NormalEquations] = {}
        marked = [index for index, circle in enumerate(prints) if isinstance(circle, Print)]
        self._changes = {index: photographs[index] - unpressed for index in marked}
        self._pressed = {index: ball_indentation(sensor, *self.place(index), ball_m) for index in marked}
        self.response = ResponseFit(self._changes, self._pressed)

    def circle(self, index: int) -> Print:
        circle = self._prints[index]
        assert isinstance(circle, Print)
        return circle

    def disc(self, index: int, share: float = 1.0) -> np.ndarray:
        return self.circle(index).disc(self._photographs.shape[1:3], share) & self._shown[index]

    def place(self, index: int) -> tuple[np.ndarray, float]:
        """Centre (2,) of the ball across the sensor, and how deep it lies in the gel, metres."""
        sensor, circle, scale = self._sensor, self.circle(index), pixels_per_metre(self._sensor)
        right = circle.column - (sensor.image_width - 1) / 2
        down = circle.row - (sensor.image_height - 1) / 2
        contact = min(circle.radius / scale, 0.99 * self._ball)
        deep = self._ball - np.sqrt(self._ball**2 - contact**2) + float(gel_sag(sensor, np.array(contact**2)))
        return np.asarray(sensor.camera_position_m)[1:] - np.array([right, down]) / scale, float(deep)

    def equations(self, chosen: Sequence[int]) -> NormalEquations:
        total = self._gel
        for index in chosen:
            if index not in self._of:
                place = *self.place(index), self._ball
                shown = self._shown[index]
                pixels = ball_pixels(self._sensor, self._photographs[index], *place, share=1.0, shown=shown)
                self._of[index] = normal_equations(pixels, SHAPE)
            total = total + self._of[index]
        return total

    def errors(
        self, chosen: Sequence[int], others: Sequence[int], smoothness: float, uniformity: float, share: float
    ) -> list[np.ndarray]:
        """Errors (pixels, 3), grey levels, in the circles of others by the table of those chosen."""
        table = self.equations(chosen).solve(smoothness, uniformity, share)
        sensor = replace(_plain(self._sensor), photometric_table=table)
        return [
            (ball_image(sensor, *self.place(index), self._ball) - self._photographs[index])[self.disc(index)]
            for index in others
        ]

    def weights(self, chosen: Sequence[int]) -> tuple[float, float, float]:
        """Smoothness, uniformity and share by which others explain each of those chosen best."""

        def error(*weights: float) -> float:
            return sum(
                _square(part) for rest, fold in _folds(chosen) for part in self.errors(rest, fold, *weights)
            )

        smoothness = min(SMOOTHNESS, key=lambda weight: error(weight, UNIFORMITY[2], SHARES[0]))
        uniformity = min(UNIFORMITY, key=lambda weight: error(smoothness, weight, SHARES[0]))
        share = min(SHARES, key=lambda share: error(smoothness, uniformity, share))
        return smoothness, uniformity, share

    def changes(
        self, chosen: Sequence[int], others: Sequence[int], weights: tuple[float, float, float]
    ) -> list[np.ndarray]:
        """Changes (height, width, 3), grey levels, in the contacts of others by the table of those chosen."""
        table = self.equations(chosen).solve(*weights)
        sensor = replace(_plain(self._sensor), photometric_table=table)
        gel = ray_grid(sensor, 1).gel_values.reshape(self._photographs.shape[1:]) * 255.0
        return [ball_image(sensor, *self.place(index), self._ball) - gel for index in others]

    def round_errors(
        self,
        others: Sequence[int],
        changes: Sequence[np.ndarray],
        response: IndentationResponse,
        blur_m: float,
    ) -> list[np.ndarray]:
        """Errors (height, width, 3), grey levels, of others by their changes in contact, and a response."""
        from scipy.ndimage import gaussian_filter

        field = ResponseField(response, *self._photographs.shape[1:3])
        blur = blur_m * pixels_per_metre(self._sensor)
        errors = []
        for index, change in zip(others, changes, strict=True):
            beyond = 255 * field.change(self._pressed[index]) * (self._pressed[index] == 0)[..., None]
            errors.append(gaussian_filter(change + beyond, (blur, blur, 0)) - self._changes[index])
        return errors

    def response_weights(
        self, chosen: Sequence[int], weights: tuple[float, float, float]
    ) -> tuple[float, float, float]:
        """Roughness, unevenness and blur by which others explain each of those chosen best."""

        folds = [(rest, fold, self.changes(rest, fold, weights)) for rest, fold in _folds(chosen)]

        def error(roughness: float, unevenness: float, blurs: Sequence[float]) -> np.ndarray:
            total = np.zeros(len(blurs))
            for rest, fold, changes in folds:
                response = self.response.solve(rest, roughness, unevenness)
                for place, blur in enumerate(blurs):
                    errors = self.round_errors(fold, changes, response, blur)
                    for index, picture in zip(fold, errors, strict=True):
                        # The contact, which is smaller, counts as much as what is round it.
                        for share in (1.0, UNTOUCHED):
                            total[place] += _square(picture[self.disc(index, share)])
            return total

        middle = BLURS_M[2:3]
        roughness = min(ROUGHNESS, key=lambda value: error(value, UNEVENNESS[0], middle)[0])
        unevenness = min(UNEVENNESS, key=lambda value: error(roughness, value, middle)[0])
        return roughness, unevenness, BLURS_M[int(error(roughness, unevenness, BLURS_M).argmin())]


def _folds(chosen: Sequence[int]) -> list[tuple[list[int], Sequence[int]]]:
    """The others of each part of those chosen, and the part."""
    count = len(chosen) if len(chosen) <= FEW else FOLDS
    parts = [chosen[start::count] for start in range(count)]
    return [([index for index in chosen if index not in part], part) for part in parts]


def _from_mean_patch(
    photographs: np.ndarray, fit: _Fit, chosen: Sequence[int], others: Sequence[int]
) -> list[np.ndarray]:
    """Errors in the circles of others by the mean of the patches of those chosen, centre on centre."""
    return [
        np.nanmean([_shifted(photographs[source], fit, source, index) for source in chosen], axis=0)
        - photographs[index][fit.disc(index)]
        for index in others
    ]


def _between_alike(photographs: np.ndarray, fit: _Fit, marked: Sequence[int]) -> list[np.ndarray]:
    """Differences between photographs whose circles are nearly the same, laid centre on centre."""
    pairs = []
    for position, first in enumerate(marked):
        for second in marked[position + 1 :]:
            a, b = fit.circle(first), fit.circle(second)
            if max(np.hypot(a.column - b.column, a.row - b.row), abs(a.radius - b.radius)) < ALIKE_PIXELS:
                difference = (
                    _shifted(photographs[second], fit, second, first) - photographs[first][fit.disc(first)]
                )
                pairs.append(difference[np.isfinite(difference).all(axis=1)])
    return pairs


def _shifted(photo: np.ndarray, fit: _Fit, source: int, target: int) -> np.ndarray:
    """Values (pixels, 3) of a photograph in the circle of another, its own centre on the other's."""
    a, b = fit.circle(source), fit.circle(target)
    rows, columns = np.nonzero(fit.disc(target))
    rows, columns = rows + round(a.row - b.row), columns + round(a.column - b.column)
    inside = (rows >= 0) & (columns >= 0) & (rows < photo.shape[0]) & (columns < photo.shape[1])
    values = np.full((len(rows), 3), np.nan)
    values[inside] = photo[rows[inside], columns[inside]]
    return values


def _square(errors: np.ndarray) -> float:
    return float(np.nanmean(errors.astype(np.float64) ** 2))


def _psnr(errors: Sequence[np.ndarray]) -> np.ndarray:
    return np.array([10 * np.log10(255**2 / max(_square(part), 1e-6)) for part in errors])
