"""Thousands of strikes on several objects at once: what `strike` answers, as one matrix product an object.

Free motion at sample b B + j is a product of a table over blocks b and one over samples j of a block, and
what is heard is linear in the modal velocities: both tables are made in double precision on the host and
multiplied in single precision on the device, without TF32.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from objectfolder.audio.synthesis.bank import samples_of
from objectfolder.audio.synthesis.oscillators import moved
from objectfolder.audio.synthesis.pulses import course_of
from objectfolder.audio.synthesis.sound_queries import SoundQueries
from objectfolder.audio.synthesis.sources import Source
from objectfolder.audio.synthesis.struck_body import CONTACT
from objectfolder.batch.resident import closest, numbers, object_indices, resident_trees, upload
from objectfolder.batch.targets import Tensor, checked_device, full_precision, torch
from objectfolder.errors import QueryError

# Numbers of one product's left side.
NUMBERS_AT_ONCE = 1 << 26
BATCH_TABLES = 64
LONGEST_BLOCK = 1024


class SoundBatch:
    """Modes of objects on a device.

    Parameters
    ----------
    sounds
        ``ObjectFile.sound`` of each object.
    device
        ``"cuda"`` or ``"cpu"``.

    Raises
    ------
    QueryError
        A device that is not there, an object without sound.
    """

    def __init__(self, sounds: Sequence[SoundQueries], device: str | torch.device = "cuda") -> None:
        self.device = checked_device(device)
        self._objects = [_Struck(sound, self.device) for sound in sounds]
        self._trees = resident_trees([sound.contacts.surface for sound in sounds], self.device)

    def strike(
        self,
        objects: object,
        points: object,
        impulses_n_s: object,
        duration_s: float = 2.0,
        sample_rate_hz: float = 44100.0,
        *,
        pulse_s: float | None = None,
        observed: str = CONTACT,
        listener: Sequence[float] | None = None,
        out: Tensor | None = None,
    ) -> Tensor:
        """Sound objects under impulses: (n, samples) float32 on the device.

        Parameters
        ----------
        objects
            (n,) which of the objects each strike is on, or one for all.
        points, impulses_n_s
            (n, 3) object frame, metres, newton seconds; the nearest points of the surfaces are struck.
        duration_s, sample_rate_hz, observed, listener
            As for `ObjectFile.strike`; at most one listener (3,).
        pulse_s
            Length of the half-sine that carries all impulses; an instant if None.
        out
            (n, samples) float32 to be filled; new if None.
        """
        # Arrays of any library are taken: their common type, `object`, has no length.
        count = len(points)  # type: ignore[arg-type]
        which = object_indices(objects, count, len(self._objects), self.device)
        places = numbers("points", points, (count, 3), self.device)
        pushes = numbers("impulses_n_s", impulses_n_s, (count, 3), self.device)
        samples = samples_of(duration_s, sample_rate_hz)
        shape = (count, samples)
        sound = torch.empty(shape, dtype=torch.float32, device=self.device) if out is None else out
        if sound.shape != shape or sound.dtype != torch.float32:
            raise QueryError("out", f"{sound.dtype} {tuple(sound.shape)}", f"Give float32 {shape}.")
        face, barycentric = closest(self._trees, which, places)
        heard = None if listener is None else tuple(float(part) for part in listener)
        for index in which.unique().tolist():
            rows = None if len(self._objects) == 1 else torch.nonzero(which == index)[:, 0]
            some = slice(None) if rows is None else rows
            struck = self._objects[index]
            gains, normal = struck.gains(face[some], barycentric[some])
            with full_precision():
                tables = struck.tables(samples, float(sample_rate_hz), pulse_s, observed, heard)
                write(tables, gains, normal, pushes[some], sound, rows)
        return sound


class _Struck:
    """One object: its mode shapes on the surface, and tables of its sounds."""

    def __init__(self, sound: SoundQueries, device: torch.device) -> None:
        self._body, self._device, net = sound._struck_body(None), device, sound.net
        surface = sound.contacts.surface
        self._modes = len(net.eigenvalues)
        self._normals = upload(surface.corner_normals, device), upload(surface.face_normals, device)
        self._faces = upload(surface.faces, device)
        centres, weights = net._prepared
        self._centres, self._weights = upload(centres, device), upload(weights, device)
        self._features = upload(net._kernel._vertex_features, device)
        vertices, values = net.corrections()
        row = np.full(len(surface.vertices), len(vertices))
        row[vertices] = np.arange(len(vertices))
        self._row = upload(row, device)
        values = np.concatenate(
            [values.reshape(len(values), 3 * self._modes), np.zeros((1, 3 * self._modes))]
        )
        self._corrections = upload(values, device)
        self.tables = lru_cache(maxsize=BATCH_TABLES)(self._tables)

    def gains(self, face: Tensor, barycentric: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mode shapes (n, 3, modes) and unit normals (n, 3) at places of the surface."""
        corners = self._faces[face]
        features = torch.einsum("ij,ijk->ik", barycentric, self._features[corners])
        gains = _covariance(features, self._centres) @ self._weights
        gains += torch.einsum("ij,ijk->ik", barycentric, self._corrections[self._row[corners]])
        normal = torch.einsum("ij,ijk->ik", barycentric, self._normals[0][face])
        length = torch.linalg.vector_norm(normal, dim=1, keepdim=True)
        flat = self._normals[1][face]
        normal = torch.where(length > 1e-12, normal / length.clamp(min=1e-300), flat)
        return gains.reshape(len(face), 3, self._modes), normal

    def _tables(
        self, samples: int, rate: float, pulse_s: float | None, observed: str,
        listener: tuple[float, ...] | None,
    ) -> list["Table"]:  # fmt: skip
        ears = None if listener is None else np.array([listener])
        (sources,) = self._body.channels(rate, observed, ears)
        return [Table(source, samples, pulse_s, self._device) for source in sources]


class Table:
    """What one source does at each sample after a unit of modal velocity in each of its modes."""

    def __init__(self, source: Source, samples: int, pulse_s: float | None, device: torch.device) -> None:
        bank, oscillators = source.bank, source.bank.oscillators
        delay, modes = source.delay_s * oscillators.sample_rate_hz, len(bank)
        self.begin = min(int(np.ceil(delay)), samples)
        ahead = self.begin - delay if self.begin < samples else 0.0
        onset, states = bank.onset(np.eye(modes), course_of(pulse_s), ahead, samples - self.begin)
        self.free = self.begin + onset.shape[1]
        state = np.diagonal(states, axis1=0, axis2=2)
        block = min(max(16, 16 * (math.isqrt(max(samples - self.begin - 1, 0)) // 8)), LONGEST_BLOCK)
        blocks = -(-(samples - self.free) // block)
        coarse = _interleaved(moved(oscillators.propagator(block * np.arange(blocks)), state))
        heard = bank.weights[:, None] * oscillators.propagator(np.arange(block))
        fine = _interleaved(heard.sum(axis=1)).T
        self.onset, self.coarse, self.fine = (
            upload(part, device, np.float32) for part in (onset, coarse, fine)
        )
        self.columns = upload(bank.columns, device)
        self.gains = None if source.gains is None else upload(source.gains, device)
        self.observed = None if source.observed is None else upload(source.observed, device)

    def amplitudes(self, gains: Tensor, normal: Tensor, pushes: Tensor) -> Tensor:
        """Return the amplitudes (n, modes) float32 that impulses (n, 3) give."""
        if self.gains is not None:
            along = pushes @ self.gains
        else:
            along = torch.einsum("ij,ijk->ik", pushes, gains)
            heard = torch.einsum("ij,ijk->ik", normal, gains) if self.observed is None else self.observed
            along = along * heard
        return along[:, self.columns].float()


def write(
    tables: list[Table], gains: Tensor, normal: Tensor, pushes: Tensor, sound: Tensor, rows: Tensor | None
) -> None:
    """Write the sounds of some strikes into rows of `sound`, all of them if None."""
    amplitudes = [table.amplitudes(gains, normal, pushes) for table in tables]
    step = max(1, NUMBERS_AT_ONCE // max(1, *(table.coarse.numel() for table in tables)))
    for start in range(0, len(pushes), step):
        part = slice(start, min(start + step, len(pushes)))
        target = sound[part] if rows is None else torch.empty_like(sound[: part.stop - start])
        target.zero_()
        for table, amplitude in zip(tables, amplitudes, strict=True):
            some = amplitude[part]
            if table.free > table.begin:
                target[:, table.begin : table.free] += some @ table.onset
            tail = target.shape[1] - table.free
            if tail and some.shape[1]:
                each = some.repeat_interleave(2, dim=1)[:, None, :] * table.coarse
                product = (each.reshape(-1, each.shape[2]) @ table.fine).reshape(len(some), -1)
                target[:, table.free :] += product[:, :tail]
        if rows is not None:
            sound[rows[part]] = target


def _interleaved(rows: np.ndarray) -> np.ndarray:
    """Two a mode, (n, 2, modes), as (n, 2 modes), mode by mode."""
    return rows.swapaxes(1, 2).reshape(len(rows), -1)


def _covariance(a: Tensor, b: Tensor) -> Tensor:
    """`surface_kernel.SurfaceKernel.covariance` on a device."""
    first, second = a[:, 3:], b[:, 3:]
    r = first @ (-2 * second.T) + (first * first).sum(1)[:, None] + (second * second).sum(1)
    r = r.clamp(min=0.0).sqrt()
    return torch.exp(-r) * (((r / 15 + 0.4) * r + 1) * r + 1) * (a[:, :3] @ b[:, :3].T + 1)
