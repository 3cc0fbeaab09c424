"""Procedural base colours: smooth noise, bands, checks, dots, over the unit square of texture coordinates."""

import numpy as np

SIZE = 512
"""Texels a side of every starter texture."""


def unit_square() -> tuple[np.ndarray, np.ndarray]:
    """Texture coordinates u and v, (SIZE, SIZE) each, of the texel centres; row 0 has the largest v."""
    centres = (np.arange(SIZE) + 0.5) / SIZE
    u, v = np.meshgrid(centres, centres[::-1])
    return u, v


def smooth_noise(cells_u: int, cells_v: int, seed: int, octaves: int = 3) -> np.ndarray:
    """Value noise (SIZE, SIZE) in 0..1 that repeats in u and v; each octave halves cell and amplitude."""
    random = np.random.default_rng(seed)
    u, v = unit_square()
    total, amplitude, sum_of_amplitudes = np.zeros((SIZE, SIZE)), 1.0, 0.0
    for _ in range(octaves):
        lattice = random.random((cells_v, cells_u))
        column, row = np.floor(u * cells_u).astype(int), np.floor(v * cells_v).astype(int)
        across, up = (smooth_step(x - np.floor(x)) for x in (u * cells_u, v * cells_v))
        left, right = column % cells_u, (column + 1) % cells_u
        low, high = row % cells_v, (row + 1) % cells_v
        lower = lattice[low, left] * (1 - across) + lattice[low, right] * across
        upper = lattice[high, left] * (1 - across) + lattice[high, right] * across
        total += amplitude * (lower * (1 - up) + upper * up)
        sum_of_amplitudes += amplitude
        cells_u, cells_v, amplitude = 2 * cells_u, 2 * cells_v, amplitude / 2
    return total / sum_of_amplitudes


def smooth_step(x: np.ndarray) -> np.ndarray:
    """Cubic from 0 at x <= 0 to 1 at x >= 1."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def between(x: np.ndarray, low: float, high: float, softness: float = 0.002) -> np.ndarray:
    """1 where low < x < high, 0 elsewhere, with soft edges a texel or two wide."""
    return smooth_step((x - low) / softness + 0.5) * smooth_step((high - x) / softness + 0.5)


def paint(image: np.ndarray, colour: tuple[float, float, float], coverage: np.ndarray) -> np.ndarray:
    """Blend a colour over (SIZE, SIZE, 3) by coverage (SIZE, SIZE) in 0..1."""
    return image + coverage[..., None] * (np.array(colour) - image)


def flat(colour: tuple[float, float, float]) -> np.ndarray:
    """(SIZE, SIZE, 3) of one colour."""
    return np.broadcast_to(np.array(colour), (SIZE, SIZE, 3)).copy()


def to_texture(image: np.ndarray) -> np.ndarray:
    """(SIZE, SIZE, 4) uint8 RGBA of (SIZE, SIZE, 3) sRGB-encoded 0..1."""
    rgb = np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)
    return np.concatenate([rgb, np.full((*rgb.shape[:2], 1), 255, dtype=np.uint8)], axis=2)
