"""What networks are shown: images, spectrograms and touches of an object, drawn by a seed.

Places are where a query asks: the direction of a camera, or the point of a contact. A split by region holds
out whole regions of them, so that no test query has a neighbour among the training ones.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2
from torch.nn.functional import adaptive_avg_pool2d, adaptive_max_pool2d

from learning.meshes import TouchedMesh
from objectfolder.dataset import ObjectFolderDataset
from objectfolder.errors import InputError
from objectfolder.object_file import ObjectFile

Floats = NDArray[np.float64]
Source = ObjectFile | TouchedMesh
Choice = Callable[[Floats], NDArray[np.bool_]]
SENSES = ("vision", "audio", "touch")
SUB_RAYS = 4
DEPTHS_M = (0.0005, 0.002)
IMPULSES_N_S = (0.3, 3.0)
SAMPLE_RATE_HZ, DURATION_S, WINDOW, FRAMES = 44100.0, 0.5, 1024, 64
# Velocity in m/s below which the spectrogram is flat; struck objects begin at .01 to 100.
QUIET_M_S = 1e-4
HELD_OUT_REGIONS, REGION_SAMPLES = 0.2, 2000
MOST_DRAWS = 200
PRESSED = 250  # at a time: thousands of full images would fill a memory
TRIED_VERTICES = 1000  # at a time, until enough can be pressed: scans have tens of thousands


@dataclass(frozen=True)
class Samples:
    """Samples of one sense of one object.

    Attributes
    ----------
    inputs : (n, channels, height, width) float32, of touch float16: half of the memory for thousands, and
        finer than the 8 bits of what is averaged
    places : (n, 3) unit vectors to the camera, or contacts in metres, object frame
    queries : (n, ...) what was asked there: camera (16) and lamp (3) of an image, an impulse (3) in newton
        seconds, a depth (1) in metres
    extent : what distances between places are shares of, metres: the object's longest side; 1 for directions
    """

    inputs: torch.Tensor
    places: Floats
    queries: Floats
    extent: float


def spectrograms(sounds: NDArray[np.float32], resolution: int) -> torch.Tensor:
    """Return log magnitudes (n, 1, 2 resolution, FRAMES); loudness is kept, nothing is normalised.

    Parameters
    ----------
    sounds
        (n, samples) velocities in m/s at `SAMPLE_RATE_HZ`.
    """
    waves = torch.as_tensor(sounds)
    window = torch.hann_window(WINDOW)
    hop = waves.shape[1] // FRAMES
    spectrum = torch.stft(waves, WINDOW, hop, window=window, return_complex=True).abs() / window.sum()
    # The largest of the bins that are joined: a mode stays as loud as it is.
    pooled = adaptive_max_pool2d(spectrum[:, None, :, :FRAMES], (2 * resolution, FRAMES))
    return torch.log10(pooled / QUIET_M_S + 1) / 3


def pictures(images: torch.Tensor, resolution: int) -> torch.Tensor:
    """Return images (n, 3, h, w) with means of their pixels, `resolution` on the shorter side."""
    height, width = images.shape[2:]
    scale = resolution / min(height, width)
    return adaptive_avg_pool2d(images, (round(height * scale), round(width * scale)))


def _from_bytes(images: NDArray[np.uint8]) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(images.transpose(0, 3, 1, 2), dtype=np.float32)) / 255


def regions_of(file: Source, sense: str, regions: int, seed: int) -> tuple[Choice, Choice]:
    """Return which places are for training and which for testing, by regions of k-means.

    Parameters
    ----------
    regions
        Of the surface by its points, or of the sphere of cameras by directions; a fifth is held out.
    """
    random = np.random.default_rng(seed)
    if sense == "vision":
        seen = _with_all_senses(file)
        places = _directions(seen, seen.sample_views(REGION_SAMPLES, seed)[0])
    else:
        places, _ = file.sample_contacts(REGION_SAMPLES, seed, reachable=False)
    centres, _ = kmeans2(places, regions, minit="++", rng=random)
    held_out = random.permutation(regions) < HELD_OUT_REGIONS * regions

    def tested(points: Floats) -> NDArray[np.bool_]:
        distances = np.linalg.norm(points[:, None] - centres, axis=2)
        return held_out[np.argmin(distances, axis=1)]

    return lambda points: ~tested(points), tested


def _with_all_senses(file: Source) -> ObjectFile:
    if not isinstance(file, ObjectFile):
        raise TypeError(f"{file.name}: a mesh that is touched has no other sense")
    return file


def _directions(file: ObjectFile, cameras: Floats) -> Floats:
    away = cameras[:, :3, 3] - file.frame.centre
    return away / np.linalg.norm(away, axis=1, keepdims=True)


def draw(
    file: Source,
    sense: str,
    count: int,
    seed: int,
    resolution: int,
    *,
    chosen: Choice | None = None,
    lit: bool = True,
) -> Samples:
    """Draw answers of an Object File.

    Parameters
    ----------
    chosen
        Which places count; all if None.
    lit
        Lamps on the camera's side. The published views have one lamp anywhere, most of them dark.

    Raises
    ------
    InputError
        Hardly any place is chosen.
    """
    parts: list[tuple[Floats, Floats]] = []
    for attempt in range(MOST_DRAWS):
        draw_seed = int(np.random.SeedSequence([seed, attempt]).generate_state(1)[0])
        places, queries = _queries(file, sense, count, draw_seed, lit)
        mask = np.ones(count, dtype=bool) if chosen is None else chosen(places)
        parts.append((places[mask], queries[mask]))
        if sum(len(rows) for rows, _ in parts) >= count:
            places, queries = (np.concatenate(columns)[:count] for columns in zip(*parts, strict=True))
            extent = 1.0 if sense == "vision" else _length_m(file)
            return Samples(_answers(file, sense, places, queries, resolution), places, queries, extent)
    finding = f"{MOST_DRAWS} draws hold fewer than {count} places of {sense} that are chosen"
    raise InputError(file.name, finding, "Ask for fewer samples or fewer regions")


def reachable_vertices(file: Source, depth_m: float, seed: int, most: int) -> Floats:
    """Return vertices (n, 3) of the surface that the sensor can be pressed at, in random order.

    A place where several vertices lie stands once, so that parts of the rows share no place.

    Parameters
    ----------
    most
        How many are enough.
    """
    places = np.random.default_rng(seed).permutation(np.unique(file.surface.vertices, axis=0))
    reachable = places[:0]
    for first in range(0, len(places), TRIED_VERTICES):
        tried = places[first : first + TRIED_VERTICES]
        reachable = np.concatenate([reachable, tried[file.reach(tried, depth_m, rolls=1).at_some_roll]])
        if len(reachable) >= most:
            break
    return reachable[:most]


def pressed(file: Source, places: Floats, depth_m: float, resolution: int) -> Samples:
    """Press at places (n, 3) of the surface, all as deep."""
    depths = np.full((len(places), 1), depth_m)
    inputs = _answers(file, "touch", places, depths, resolution)
    return Samples(inputs, places, depths, _length_m(file))


def _length_m(file: Source) -> float:
    return float(np.ptp(file.surface.bounds, axis=0).max())


def _queries(file: Source, sense: str, count: int, seed: int, lit: bool) -> tuple[Floats, Floats]:
    """Return places (count, 3), and what is asked there, a row each; see `Samples`."""
    random = np.random.default_rng(seed)
    if sense == "vision":
        seen = _with_all_senses(file)
        cameras, lights = seen.sample_views(count, seed, lit=lit)
        return _directions(seen, cameras), np.hstack([cameras.reshape(count, 16), lights])
    points, normals = file.sample_contacts(count, seed, reachable=sense == "touch")
    if sense == "touch":
        return points, random.uniform(*DEPTHS_M, (count, 1))
    low, high = np.log(IMPULSES_N_S)
    return points, -normals * np.exp(random.uniform(low, high, (count, 1)))


def _answers(file: Source, sense: str, places: Floats, queries: Floats, resolution: int) -> torch.Tensor:
    if sense == "touch":
        return _touches(file, places, queries[:, 0], resolution)
    file = _with_all_senses(file)
    if sense == "vision":
        cameras, lights = queries[:, :16].reshape(-1, 4, 4), queries[:, 16:]
        return _from_bytes(file.render(cameras, lights, resolution, sub_rays=SUB_RAYS))
    return spectrograms(file.strike(places, queries, DURATION_S, SAMPLE_RATE_HZ), resolution)


def _touches(file: Source, places: Floats, depths_m: Floats, resolution: int) -> torch.Tensor:
    parts = range(0, len(places), PRESSED)
    images = (file.press(places[row : row + PRESSED], depths_m[row : row + PRESSED]).rgb for row in parts)
    return torch.cat([pictures(_from_bytes(part), resolution).half() for part in images])


def stored(
    dataset: ObjectFolderDataset, count: int, seed: int, resolutions: Sequence[int]
) -> list[torch.Tensor]:
    """Return inputs of `count` queries of one object's data set, by each of several resolutions.

    Truth and Object File get the same queries. Touches are half floats, as those of `Samples`.
    """
    rows = np.random.default_rng(seed).permutation(len(dataset))[:count]
    samples = dataset.__getitems__(rows.tolist())
    if dataset.sense == "audio":
        sounds = np.stack([sample["sound"].numpy() for sample in samples])
        return [spectrograms(sounds, resolution) for resolution in resolutions]
    images = torch.stack([sample["image"] for sample in samples])
    inputs = [pictures(images, resolution) for resolution in resolutions]
    return [image.half() for image in inputs] if dataset.sense == "touch" else inputs
