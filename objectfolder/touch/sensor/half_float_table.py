"""Tables of half floats that belong to a sensor: in its JSON, and as .npy files beside its own."""

import base64
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from objectfolder.errors import FormatError, InputError
from objectfolder.products.regular_file import require_regular


@dataclass(frozen=True, eq=False)
class HalfFloatTable:
    """Coefficients as half floats; equal where all of them are.

    A subclass names itself and its layout, and checks the shape.

    Raises
    ------
    ValueError
        Another shape or type, or values that are not finite.
    """

    coefficients: np.ndarray

    NAME: ClassVar[str]
    LAYOUT: ClassVar[str]

    @classmethod
    def fits(cls, shape: tuple[int, ...]) -> bool:
        """Whether coefficients may have this shape."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        shape, kind = self.coefficients.shape, self.coefficients.dtype
        if not self.fits(shape):
            raise ValueError(f"{self.NAME} of shape {shape}, expected {self.LAYOUT}")
        if kind != np.float16:
            raise ValueError(f"{self.NAME} of type {kind}, expected float16")
        if not np.isfinite(self.coefficients).all():
            raise ValueError(f"{self.NAME} with values that are not finite")

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self._bytes == other._bytes

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _bytes(self) -> tuple[tuple[int, ...], bytes]:
        return self.coefficients.shape, self.coefficients.tobytes()

    @cached_property
    def _hash(self) -> int:
        return hash(self._bytes)

    def to_dict(self) -> dict[str, Any]:
        """Return the table as JSON: shape, and little-endian half floats in base 64."""
        packed = base64.b64encode(self.coefficients.astype("<f2").tobytes()).decode("ascii")
        return {"shape": list(self.coefficients.shape), "float16": packed}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Return the table that `to_dict` described.

        Raises
        ------
        FormatError
            Anything else.
        """
        try:
            data = np.frombuffer(base64.b64decode(values["float16"], validate=True), dtype="<f2")
            return cls(data.reshape(values["shape"]).astype(np.float16))
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError(cls.NAME, f"not as it was written ({error})") from error

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a table of any floating type from an .npy file.

        Raises
        ------
        InputError
            A file that is not there, or no table.
        """
        try:
            require_regular(path)
            stored = np.load(path, allow_pickle=False)
            if not np.issubdtype(stored.dtype, np.floating):
                raise ValueError(f"its type is {stored.dtype}")
            with np.errstate(over="ignore"):
                return cls(stored.astype(np.float16))
        except (OSError, ValueError) as error:
            remedy = f"Write an array {cls.LAYOUT} with numpy.save; see {cls.__name__}."
            raise InputError(str(path), f"no {cls.NAME} ({error})", remedy) from error
