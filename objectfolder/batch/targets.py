"""One scalar body, two targets: a loop compiled by numba on a CPU, a kernel by numba-cuda on a GPU.

A body computes one answer: its first parameters are the indices of it, one or two. Everything that a body
calls is compiled by numba for both targets. This module alone names numba-cuda.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property, lru_cache
from types import FunctionType
from typing import Any

import numba
import numpy as np

from objectfolder.errors import QueryError
from objectfolder.extras import needs_extra

with needs_extra("gpu"):
    import torch

Tensor = torch.Tensor
# Threads of a block.
BLOCK_THREADS = 128
# Answers along the first of two indices that one launch takes: a limit of CUDA.
LAUNCH_ROWS = 65535
# Names of their own that no body has.
CPU_SOURCE = """
def kernel(from_row, all_rows, all_columns, {names}):
    {made}
    for this_row in range(from_row, from_row + all_rows):
        for this_column in range(all_columns):
            body({indices}, {passed})
"""
GPU_SOURCE = """
def kernel(from_row, all_rows, all_columns, {names}):
    {made}
    this_row, this_column = from_row + cuda.blockIdx.y, cuda.grid(1)
    if this_column < all_columns:
        body({indices}, {passed})
"""


def scalar(function: Callable[..., Any]) -> Any:
    """Compile what bodies call, for either target."""
    # Without what only callers in C or Python or makers of arrays need, which takes time to compile.
    wrappers = {"no_cfunc_wrapper": True, "no_cpython_wrapper": True}
    return numba.njit(function, error_model="numpy", nogil=True, _nrt=False, **wrappers)


def compiled_copy(function: Callable[..., Any], **called: Any) -> Any:
    """Compile a plain function of another module with compiled ones in place of those that it calls."""
    return scalar(FunctionType(function.__code__, {**function.__globals__, **called}))


class Body:
    """A body and its kernels, which make its records of arguments and working memory.

    Parameters
    ----------
    function
        Its first parameters are `indices` integers, the others arguments and working memory. A parameter
        annotated as a named tuple is a record: each of its fields is an argument of its own, or memory.
    indices
        One or two.
    memory
        Shape and type of the working memory of each thread, by the names of parameters or of a record's
        fields.
    """

    def __init__(
        self, function: Callable[..., Any], indices: int = 1, **memory: tuple[tuple[int, ...], Any]
    ) -> None:
        self._function, self._indices, self._memory = function, indices, memory
        self._parameters = list(inspect.signature(function).parameters.values())[indices:]

    @property
    def name(self) -> str:
        """Of the function."""
        return self._function.__name__.lstrip("_")

    def _kernel(self, source: str, array: str, **names: Any) -> Any:
        """Return the kernel around the body; `names` are those that its source uses."""
        lines = [
            # NumPy 1 and 2 have other names for this one.
            f"{name} = {array}({shape!r}, np.{'bool_' if kind is np.bool_ else kind.__name__})"
            for name, (shape, kind) in self._memory.items()
        ]
        # Of the body's module: `objectfolder.jit` compiles the package's own in less time.
        arguments, scope = [], {"np": np, "__name__": self._function.__module__, **names}
        for parameter in self._parameters:
            record, name = parameter.annotation, parameter.name
            if fields := getattr(record, "_fields", ()):
                inside = self._memory.keys() >= set(fields)
                values = [field if inside else f"{name}_{field}" for field in fields]
                lines.append(f"{name} = {record.__name__}({', '.join(values)})")
                scope[record.__name__] = record
            else:
                values = [name]
            arguments += [value for value in values if value not in self._memory]
        text = source.format(
            names=", ".join(arguments),
            made="\n    ".join(lines) or "pass",
            indices="this_row, this_column" if self._indices == 2 else "this_column",
            passed=", ".join(parameter.name for parameter in self._parameters),
        )
        exec(text, scope)
        return scope["kernel"]

    @cached_property
    def on_cpu(self) -> Any:
        """The loop, compiled when it is called."""
        loop = self._kernel(CPU_SOURCE, "np.empty", body=scalar(self._function))
        return numba.njit(loop, error_model="numpy", nogil=True)

    @cached_property
    def plain(self) -> Any:
        """The CUDA kernel as a Python function, for numba-cuda to compile."""
        cuda = cuda_module()
        body = cuda.jit(device=True)(self._function)
        return self._kernel(GPU_SOURCE, "cuda.local.array", body=body, cuda=cuda)

    @cached_property
    def on_gpu(self) -> Any:
        """The CUDA kernel, compiled when it is launched."""
        return cuda_module().jit(self.plain)

    def __call__(self, count: int | tuple[int, int], *arguments: Any) -> None:
        """Compute `count` answers, rows by columns where the body has two indices, where the tensors are."""
        rows, columns = count if isinstance(count, tuple) else (1, count)
        if rows * columns == 0:
            return
        place = next(part.device for part in arguments if isinstance(part, Tensor))
        if place.type == "cpu":
            arrays = [part.numpy() if isinstance(part, Tensor) else part for part in arguments]
            self.on_cpu(0, rows, columns, *arrays)
            return
        self.launch(rows, columns, arguments, torch.cuda.current_stream(place).cuda_stream)

    def launch(self, rows: int, columns: int, arguments: Sequence[Any], stream: int) -> None:
        """Launch the kernel on a stream of CUDA's, by its handle; 0 is the default one."""
        cuda = cuda_module()
        queue = cuda.external_stream(stream) if stream else 0
        # numba-cuda would do so twice: for the type of each, and for its address.
        arguments = [
            cuda.as_cuda_array(part, sync=False) if isinstance(part, Tensor) else part for part in arguments
        ]
        for start in range(0, rows, LAUNCH_ROWS):
            some = min(LAUNCH_ROWS, rows - start)
            self.on_gpu[(-(-columns // BLOCK_THREADS), some), BLOCK_THREADS, queue](
                start, some, columns, *arguments
            )


@lru_cache(maxsize=1)
def cuda_module() -> Any:
    """Return numba-cuda."""
    absent = not hasattr(np, "row_stack")
    if absent:
        # numba-cuda up to 0.30 names a function, as it is imported, that NumPy 2.5 no longer has.
        setattr(np, "row_stack", np.vstack)  # noqa: B010 - the linter minds the name
    try:
        with needs_extra("gpu"):
            import numba_cuda  # noqa: F401
        from numba import cuda
        from numba.cuda import cudaimpl  # noqa: F401 - else imported by the first compilation
    finally:
        if absent:
            delattr(np, "row_stack")
    return cuda


def resident(tensor: Tensor) -> Any:
    """Return a tensor as kernels take it with the least delay, for what they are given again and again."""
    return tensor if tensor.device.type == "cpu" else cuda_module().as_cuda_array(tensor, sync=False)


def checked_device(device: str | torch.device) -> torch.device:
    """Return a device that is there.

    Raises
    ------
    QueryError
        A device that is neither a CPU nor a GPU that torch finds and numba-cuda compiles for.
    """
    try:
        place = torch.device(device)
    except RuntimeError as error:
        raise QueryError("device", f"{device!r} is no device", "Use 'cuda' or 'cpu'.") from error
    if place.type == "cpu":
        return place
    if place.type != "cuda" or not torch.cuda.is_available():
        raise QueryError("device", f"torch finds no {place.type} device here", "Use 'cpu'.")
    try:
        _launch_nothing()
    except Exception as error:  # numba-cuda and the driver have no common class of errors
        reason = " ".join(str(error).split()).strip(" :.") or type(error).__name__
        raise QueryError("device", f"numba-cuda cannot use it: {reason}", "Use 'cpu'.") from error
    return place


@lru_cache(maxsize=1)
def _launch_nothing() -> None:
    """Compile, load and launch a kernel: for that there is a driver, and a toolkit that is not too new."""

    def kernel() -> None:
        return

    # numba-cuda warns of few blocks.
    cuda_module().jit(kernel)[LAUNCH_ROWS, BLOCK_THREADS]()


@contextmanager
def full_precision() -> Iterator[None]:
    """Multiply matrices without TF32, whose factors have ten bits."""
    before = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision("highest")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)
