"""A stage: a task, the products it makes of each object, and exactly what it reads."""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from objectfolder.errors import FormatError, InputError
from objectfolder.products.provenance import Constant, package_versions, seed_from
from pipeline.dataset.products import ProductKind
from pipeline.dataset.task import Request
from pipeline.dataset.tolerances import Tolerance
from pipeline.dataset.verified import FINGERPRINT, Verified

if TYPE_CHECKING:  # it takes half of the time in which a process that draws one page starts
    from pipeline.dataset.parameters import Parameters

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Prepared:
    """What the task of an object gets, the parts of its fingerprint, and its inputs by content.

    Parameters
    ----------
    request
        The argument of the task.
    parts
        Everything that decides the product.
    inputs
        Input name to the fingerprint of a product, or the SHA-256 of a source file.
    """

    request: Request
    parts: dict[str, Any]
    inputs: dict[str, str]


@dataclass(frozen=True)
class ProductInput:
    """A product of an earlier stage, or named parts of it.

    Parameters
    ----------
    kind
        Which product.
    attributes
        Dotted names of the product's attributes that stand for all that the task reads
        (``"digests.geometry"``); none where it reads everything.
    """

    kind: ProductKind
    attributes: tuple[str, ...] = ()

    def digest(self, path: Path, states: Verified) -> tuple[str, str | dict[str, Any]]:
        """Return the product's fingerprint, and a digest of the content that the task reads.

        Tasks are pure, so a fingerprint identifies a whole product.

        Raises
        ------
        InputError
            A product that is missing or unreadable.
        """
        remedy = f"See what failed in stage {self.kind.made_by}."
        try:
            attributes = states.attributes(path, (FINGERPRINT, *self.attributes))
        except FileNotFoundError as error:
            raise InputError(path.name, f"input missing: {self.kind.made_by} failed", remedy) from error
        except FormatError as error:
            raise InputError(path.name, f"input unreadable: {error}", remedy) from error
        fingerprint = attributes.pop(FINGERPRINT)
        return fingerprint, attributes if self.attributes else fingerprint


@dataclass(frozen=True)
class Stage:
    """A stage that converges its products over all objects.

    Parameters
    ----------
    name
        As in ``dvc.yaml``; part of the seed.
    task
        ``module:function`` of the task body (see `pipeline.dataset.task.Call`). The module is imported in the
        child process only; its source and what it imports is the task's code.
    products
        What the task makes of each object, in the order in which it returns them.
    inputs
        Products of earlier stages that it reads.
    sources
        From a row to the source files that the task reads, by role; for the first stage.
    parameters
        Dotted names in `Parameters` (``"vision"``, ``"touch.depth_m"``) that it reads.
    fields
        Fields of the object's row that it reads.
    packages
        Distributions whose version may change its numbers.
    optional_packages
        From the parameters that it reads to those that it takes for them besides.
    needs
        Pools of workers that can run it (`pipeline.dataset.job.BLENDER`); empty for any.
    tolerances
        Arrays that another machine may make a little different; all others are the same bytes.
    """

    name: str
    task: str
    products: tuple[ProductKind, ...]
    inputs: tuple[ProductInput, ...] = ()
    sources: Callable[[Row], Mapping[str, Path]] | None = None
    parameters: tuple[str, ...] = ()
    fields: tuple[str, ...] = ()
    packages: tuple[str, ...] = ("numpy",)
    optional_packages: Callable[[Mapping[str, Any]], tuple[str, ...]] = lambda _: ()
    needs: frozenset[str] = frozenset()
    tolerances: Mapping[str, Tolerance] = field(default_factory=dict)

    @functools.cached_property
    def follows(self) -> frozenset[str]:
        """Names of the stages whose products it reads."""
        return frozenset(product.kind.made_by for product in self.inputs)

    def targets(self, root: Path, object_id: str) -> tuple[Path, ...]:
        """Return the paths of the products of an object."""
        return tuple(kind.path(root, object_id) for kind in self.products)

    def prepare(
        self, root: Path, parameters: "Parameters", object_id: str, row: Row, states: Verified
    ) -> Prepared:
        """Return what the task of an object gets, and what its products are made from.

        Raises
        ------
        InputError
            An input that is missing.
        """
        paths: dict[str, Path] = {}
        digests: dict[str, Any] = {}
        contents: dict[str, str] = {}
        for product in self.inputs:
            path = paths[product.kind.name] = product.kind.path(root, object_id)
            contents[product.kind.name], digests[product.kind.name] = product.digest(path, states)
        for role, path in (self.sources(row) if self.sources else {}).items():
            paths[role] = path
            contents[role] = digests[role] = source_digest(path, states)
        values = parameters.values(self.parameters)
        record = {name: row[name] for name in self.fields}
        seed = seed_from(parameters.seed, self.name, object_id)
        parts = {
            "task": self.name,
            "parameters": values,
            "record": record,
            "inputs": digests,
            "code": states.code_identity(self.task.partition(":")[0]),
            "packages": _versions((*self.packages, *self.optional_packages(values))),
            "seed": seed,
        }
        return Prepared(Request(object_id, paths, values, record, seed), parts, contents)

    def lineage(self, parts: Mapping[str, Any]) -> dict[str, str]:
        """Return the fingerprints of the whole products that the task reads, by stage."""
        return {
            product.kind.made_by: parts["inputs"][product.kind.name]
            for product in self.inputs
            if not product.attributes
        }


@functools.cache
def _versions(packages: tuple[str, ...]) -> Constant:
    return Constant(package_versions(packages))


def source_digest(path: Path, states: Verified) -> str:
    """Return the SHA-256 of a source file.

    Raises
    ------
    InputError
        A file that cannot be read.
    """
    try:
        return states.source_digest(path)
    except OSError as error:
        raise InputError(
            str(path), f"cannot be read ({error.strerror})", "Correct the path in the table."
        ) from error
