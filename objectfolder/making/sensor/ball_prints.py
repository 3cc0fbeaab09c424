"""Where a ball lies in photographs of a sensor that it is pressed into: centre and contact circle.

In the contact the change of a pixel follows from the ball's normal there, which the distance from the centre
gives; beyond it the change fades. How change follows normal is the same in all photographs: two quadratic
models of it, inside and outside, and the circles are improved in turn until they agree. Needs SciPy.
"""

from dataclasses import dataclass

import numpy as np

# Pixels of a photograph a pixel of the search, and steps of the search in those.
REDUCTION = 4
SEARCH_STEPS_PX = (4, 4, 2, 2, 1, 1, 0.5, 0.5, 0.25)
# A mark is this many deviations of the camera's noise above nothing.
LEAST_CONTRAST = 4.0
# Share of the squared change round a mark that its circle must explain.
LEAST_EXPLAINED = 0.5
# Of the ball's radius.
SMALLEST, LARGEST_CIRCLE = 0.3, 0.95


@dataclass(frozen=True, eq=False)
class Print:
    """A contact circle in a photograph: column and row of its centre and its radius, pixels."""

    column: float
    row: float
    radius: float

    def disc(self, shape: tuple[int, ...], share: float = 1.0) -> np.ndarray:
        """Which pixels (height, width) of an image lie within a share of the radius."""
        rows, columns = np.indices(shape)
        return np.asarray(np.hypot(columns - self.column, rows - self.row) < share * self.radius)


def find_prints(changes: np.ndarray, ball_pixels: float) -> list[Print | str]:
    """Find the contact circle of each photograph, or why there is none.

    Parameters
    ----------
    changes
        (n, height, width, 3): photographs less what the sensor shows untouched, grey levels.
    ball_pixels
        Radius of the ball, pixels of the photographs.
    """
    search = _Search(changes, ball_pixels)
    search.improve()
    return [search.answer(index) for index in range(len(changes))]


class _Search:
    def __init__(self, changes: np.ndarray, ball_pixels: float) -> None:
        from scipy.ndimage import gaussian_filter

        count, height, width = changes.shape[:3]
        rows, columns = height // REDUCTION, width // REDUCTION
        whole = changes[:, : rows * REDUCTION, : columns * REDUCTION].astype(np.float64)
        self.change = whole.reshape(count, rows, REDUCTION, columns, REDUCTION, 3).mean(axis=(2, 4))
        self.change -= np.median(self.change, axis=(1, 2), keepdims=True)
        self.ball = ball_pixels / REDUCTION
        self.row, self.column = np.indices((rows, columns)).astype(np.float64)
        self.place = np.stack(
            [np.ones((rows, columns)), 2 * self.column / columns - 1, 2 * self.row / rows - 1], axis=-1
        )
        self.circles = np.zeros((count, 3))
        self.failures: list[str] = []
        self.explained = np.zeros(count)
        for index, change in enumerate(self.change):
            energy = gaussian_filter((change**2).sum(axis=2), 2.0)
            noise = np.median(energy)
            bright = energy >= energy.max() / 4
            weight = np.maximum(energy, 1e-9) * bright
            centre = [(part * weight).sum() / weight.sum() for part in (self.column, self.row)]
            radius = min(np.sqrt(bright.sum() / np.pi), 0.85 * self.ball)
            self.circles[index] = *centre, max(radius, SMALLEST * self.ball)
            contrast = np.sqrt(energy.max() / max(noise, 0.25))
            low = contrast < LEAST_CONTRAST
            self.failures.append(
                f"no mark: the change is {contrast:.1f} times what it is elsewhere" if low else ""
            )

    def improve(self) -> None:
        """Fit the models to the circles and the circles to the models, in turn."""
        chosen = [index for index, failure in enumerate(self.failures) if not failure]
        for step in SEARCH_STEPS_PX if chosen else ():
            models = self._models(chosen)
            for index in chosen:
                self._move(index, step, models)

    def answer(self, index: int) -> Print | str:
        """Return the circle of a photograph, or why it has none."""
        if self.failures[index]:
            return self.failures[index]
        column, row, radius = self.circles[index]
        rows, columns = self.row.shape
        if not (0 <= column < columns and 0 <= row < rows):
            return "no circle: its centre is outside the picture"
        if self.explained[index] < LEAST_EXPLAINED:
            share = f"{self.explained[index]:.0%}"
            return f"no circle: the best one explains {share} of the mark"
        middle = (REDUCTION - 1) / 2
        return Print(column * REDUCTION + middle, row * REDUCTION + middle, radius * REDUCTION)

    def _box(self, circle: np.ndarray) -> tuple[slice, slice]:
        reach = 2.2 * self.ball
        low = np.maximum(circle[:2] - reach, 0).astype(int)
        high = (circle[:2] + reach + 1).astype(int)
        return slice(low[1], high[1]), slice(low[0], high[0])

    def _terms(
        self, circle: np.ndarray, box: tuple[slice, slice]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Which pixels lie inside and outside, and the terms of the models there."""
        x, y = (self.column[box] - circle[0]) / self.ball, (self.row[box] - circle[1]) / self.ball
        distance, edge, place = np.hypot(x, y), circle[2] / self.ball, self.place[box]
        inside, outside = distance < edge, distance >= edge
        a, b = x[inside], y[inside]
        near = np.stack([a, b, a * a, a * b, b * b], axis=-1)
        fading = (edge / distance[outside]) ** 2
        a, b = x[outside] / distance[outside], y[outside] / distance[outside]
        far = np.stack([fading, a * fading, b * fading], axis=-1)
        products = (
            (terms[:, :, None] * place[where][:, None, :]).reshape(len(terms), -1)
            for terms, where in ((near, inside), (far, outside))
        )
        return inside, outside, *products

    def _models(self, chosen: list[int]) -> list[np.ndarray]:
        sums = [[np.zeros((size, size)), np.zeros((size, 3))] for size in (15, 9)]
        for index in chosen:
            box = self._box(self.circles[index])
            inside, outside, *terms = self._terms(self.circles[index], box)
            for total, part, where in zip(sums, terms, (inside, outside), strict=True):
                total[0] += part.T @ part
                total[1] += part.T @ self.change[index][box][where]
        # A little ridge: one photograph alone says nothing of how models depend on the place.
        return [
            np.linalg.solve(matrix + 1e-3 * np.trace(matrix) / len(matrix) * np.eye(len(matrix)), right)
            for matrix, right in sums
        ]

    def _move(self, index: int, step: float, models: list[np.ndarray]) -> None:
        """Take steps to the best neighbour while there is a better one."""
        box = self._box(self.circles[index])
        change = self.change[index][box]

        def cost(circle: np.ndarray) -> float:
            inside, outside, *terms = self._terms(circle, box)
            parts = zip((inside, outside), terms, models, strict=True)
            return float(sum(((change[where] - part @ model) ** 2).sum() for where, part, model in parts))

        best = cost(self.circles[index])
        for _ in range(12):
            before = best
            for axis, size in ((0, step), (0, -step), (1, step), (1, -step), (2, step / 2), (2, -step / 2)):
                moved = self.circles[index].copy()
                moved[axis] += size
                if SMALLEST <= moved[2] / self.ball <= LARGEST_CIRCLE and (value := cost(moved)) < best:
                    best, self.circles[index] = value, moved
            if best == before:
                break
        self.explained[index] = 1 - best / (change**2).sum()
