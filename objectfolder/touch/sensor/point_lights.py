"""Cook-Torrance under point lights in vector registers; as `objectfolder.touch.sensor.shading`."""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from objectfolder.jit import arrayless, inner, relaxed_kernel
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.sensor.shading import DIELECTRIC_REFLECTANCE

# Points shaded at once: their intermediate values stay in the cache.
BLOCK_POINTS = 512
# Darker pixel values than 2 to this are 2 to this: a thousandth of a grey level.
LOWEST_OCTAVE = -18


def _chebyshev(function: Callable[[np.ndarray], np.ndarray], degree: int) -> tuple[np.float32, ...]:
    """Coefficients, from the constant one, of the interpolation of a function on 0..1."""
    fitted = np.polynomial.Chebyshev.interpolate(function, degree, domain=[0, 1])
    return tuple(np.float32(part) for part in fitted.convert(kind=np.polynomial.Polynomial).coef)


# log2(1 + f) and 2^f, to 4e-7 and 1e-8.
LOG, EXP = _chebyshev(lambda f: np.log2(1 + f), 7), _chebyshev(np.exp2, 6)
# Where the rows of a block's intermediate values begin in one array: at known distances, so that loops over
# them go into vector registers.
POSITION, NORMAL, VIEW_ROW = 0, 3 * BLOCK_POINTS, 6 * BLOCK_POINTS
FACING_ROW, VISIBLE_ROW, RADIANCE, WORK = (
    9 * BLOCK_POINTS,
    10 * BLOCK_POINTS,
    11 * BLOCK_POINTS,
    14 * BLOCK_POINTS,
)


@dataclass(frozen=True, eq=False)
class PointLights:
    """What shading needs of a sensor, in single precision.

    Parameters
    ----------
    camera
        (3,) metres.
    positions, colours
        (lights, 3).
    material
        (4,): GGX's alpha squared, Schlick-Smith's k, reflectance at normal incidence, diffuse albedo / pi.
    exponent
        Pixel value = radiance ** exponent.
    """

    camera: np.ndarray
    positions: np.ndarray
    colours: np.ndarray
    material: np.ndarray
    exponent: np.float32

    def shade(self, count: int, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Pixel values (3, count) float32 of the first points (3, n) with normals (3, n), both float32."""
        work, scale = np.ones(WORK, dtype=np.float32), np.empty(BLOCK_POINTS, dtype=np.float32)
        values = np.empty((3, count), dtype=np.float32)
        lights = self.camera, self.positions, self.colours, self.material, self.exponent
        working = work, work.view(np.int32), scale, scale.view(np.int32)
        _shade(positions, normals, lights, working, values)
        return values


@lru_cache(maxsize=8)
def point_lights(sensor: Sensor) -> PointLights:
    """Return the lights and the material of a sensor; see `objectfolder.touch.sensor.shading.shade`."""
    dielectric = 1 - sensor.metallic
    material = [
        sensor.roughness**4,
        (sensor.roughness + 1) ** 2 / 8,
        dielectric * DIELECTRIC_REFLECTANCE + sensor.metallic * sensor.base_colour,
        dielectric * sensor.base_colour * (1 - DIELECTRIC_REFLECTANCE) / np.pi,
    ]
    return PointLights(
        np.array(sensor.camera_position_m, dtype=np.float32),
        np.array(sensor.light_positions_m, dtype=np.float32).reshape(-1, 3),
        np.array(sensor.light_colours, dtype=np.float32).reshape(-1, 3),
        np.array(material, dtype=np.float32),
        np.float32(1 / sensor.display_gamma),
    )


@inner(arrayless(relaxed_kernel))
def _directions(work, camera, k):
    """Make the normals unit; write directions to the camera, n . v, and Smith's term of it."""
    one, least = np.float32(1), np.float32(0.001)
    for i in range(BLOCK_POINTS):
        x = camera[0] - work[POSITION + i]
        y = camera[1] - work[POSITION + BLOCK_POINTS + i]
        z = camera[2] - work[POSITION + 2 * BLOCK_POINTS + i]
        inverse = one / np.sqrt(x * x + y * y + z * z)
        x, y, z = x * inverse, y * inverse, z * inverse
        nx, ny, nz = work[NORMAL + i], work[NORMAL + BLOCK_POINTS + i], work[NORMAL + 2 * BLOCK_POINTS + i]
        inverse = one / np.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx * inverse, ny * inverse, nz * inverse
        work[VIEW_ROW + i], work[VIEW_ROW + BLOCK_POINTS + i], work[VIEW_ROW + 2 * BLOCK_POINTS + i] = x, y, z
        work[NORMAL + i], work[NORMAL + BLOCK_POINTS + i], work[NORMAL + 2 * BLOCK_POINTS + i] = nx, ny, nz
        cosine = abs(nx * x + ny * y + nz * z)
        cosine = cosine if cosine > least else least
        cosine = cosine if cosine < one else one
        work[FACING_ROW + i] = cosine
        work[VISIBLE_ROW + i] = cosine / (cosine * (one - k) + k)


@inner(arrayless(relaxed_kernel))
def _reflect(work, light, colour, alpha2, k, base, diffuse):
    """Add what the points reflect of a light to the radiance."""
    zero, one, least, four = np.float32(0), np.float32(1), np.float32(0.001), np.float32(4)
    scale = alpha2 / np.float32(np.pi)
    light_x, light_y, light_z = light[0], light[1], light[2]
    red, green, blue = colour[0], colour[1], colour[2]
    for i in range(BLOCK_POINTS):
        x = light_x - work[POSITION + i]
        y = light_y - work[POSITION + BLOCK_POINTS + i]
        z = light_z - work[POSITION + 2 * BLOCK_POINTS + i]
        squared = x * x + y * y + z * z
        inverse = one / np.sqrt(squared)
        falloff = inverse * inverse
        x, y, z = x * inverse, y * inverse, z * inverse
        vx, vy, vz = (
            work[VIEW_ROW + i],
            work[VIEW_ROW + BLOCK_POINTS + i],
            work[VIEW_ROW + 2 * BLOCK_POINTS + i],
        )
        hx, hy, hz = x + vx, y + vy, z + vz
        inverse = one / np.sqrt(hx * hx + hy * hy + hz * hz)
        nx, ny, nz = work[NORMAL + i], work[NORMAL + BLOCK_POINTS + i], work[NORMAL + 2 * BLOCK_POINTS + i]
        nl = nx * x + ny * y + nz * z
        nl = nl if nl > least else least
        nl = nl if nl < one else one
        nh = (nx * hx + ny * hy + nz * hz) * inverse
        nh = nh if nh > zero else zero
        nh = nh if nh < one else one
        vh = (vx * hx + vy * hy + vz * hz) * inverse
        vh = vh if vh > zero else zero
        miss = one - (vh if vh < one else one)
        fresnel = base + (one - base) * (miss * miss) * (miss * miss) * miss
        lobe = nh * nh * (alpha2 - one) + one
        specular = fresnel * work[VISIBLE_ROW + i] * nl * scale
        specular /= (nl * (one - k) + k) * lobe * lobe * (four * nl * work[FACING_ROW + i] + least)
        reflected = nl * falloff * ((one - fresnel) * diffuse + specular)
        work[RADIANCE + i] += red * reflected
        work[RADIANCE + BLOCK_POINTS + i] += green * reflected
        work[RADIANCE + 2 * BLOCK_POINTS + i] += blue * reflected


@inner(arrayless(relaxed_kernel))
def _encode(bits, row, exponent, values, start, size, octaves):
    """Write min(radiance, 1) ** exponent as value * 2 ** k, both by polynomials; k as the bits of a float.

    The bits of the radiance begin at `row`, the values at `start`.
    """
    one_bits, part_bits = np.int32(127 << 23), np.int32((1 << 23) - 1)
    unit, octave = np.float32(2.0**-23), np.int32(23)
    lowest = np.float32(LOWEST_OCTAVE)
    for i in range(size):
        bounded = bits[row + i] if bits[row + i] < one_bits else one_bits
        f = np.float32(bounded & part_bits) * unit
        log = ((LOG[7] * f + LOG[6]) * f + LOG[5]) * f + LOG[4]
        log = (((log * f + LOG[3]) * f + LOG[2]) * f + LOG[1]) * f + LOG[0]
        power = exponent * (np.float32((bounded >> octave) - np.int32(127)) + log)
        power = power if power > lowest else lowest
        whole = np.int32(power - lowest) + np.int32(LOWEST_OCTAVE)
        f = power - np.float32(whole)
        value = ((EXP[6] * f + EXP[5]) * f + EXP[4]) * f + EXP[3]
        value = ((value * f + EXP[2]) * f + EXP[1]) * f + EXP[0]
        octaves[i] = np.int32(whole + np.int32(127)) << octave
        values[start + i] = value


@arrayless(relaxed_kernel)
def _shade(positions, normals, lighting, working, values):
    """Write the values (3, count) of the first points.

    `lighting` are the parameters of `PointLights`. Working memory are (`WORK`,) and (`BLOCK_POINTS`,)
    float32, each followed by its int32 view.
    """
    (camera, lights, colours, material, exponent), (work, bits, scale, octaves) = lighting, working
    # Indices that cannot be negative are not tested for it.
    block, end = np.uint64(BLOCK_POINTS), np.uint64(values.shape[1])
    for start in range(np.uint64(0), end, block):
        size = block if block < end - start else end - start
        for axis in range(3):
            row, place = np.uint64(POSITION + axis * BLOCK_POINTS), positions[axis]
            for i in range(size):
                work[row + i] = place[start + i]
            row, place = np.uint64(NORMAL + axis * BLOCK_POINTS), normals[axis]
            for i in range(size):
                work[row + i] = place[start + i]
            row = np.uint64(RADIANCE + axis * BLOCK_POINTS)
            for i in range(block):
                work[row + i] = np.float32(0)
        _directions(work, camera, material[1])
        for light in range(len(lights)):
            _reflect(work, lights[light], colours[light], material[0], material[1], material[2], material[3])
        for channel in range(3):
            shown = values[channel]
            _encode(bits, np.uint64(RADIANCE + channel * BLOCK_POINTS), exponent, shown, start, size, octaves)
            for i in range(size):
                shown[start + i] *= scale[i]
