"""With an empty cache, one process of a run compiles a kernel; the others wait, and load it.

Otherwise each worker of a fresh checkout compiles the kernels that all reach in their first tests.
"""

import os
from functools import cache
from pathlib import Path
from typing import Any

from filelock import FileLock
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher


def register(folder: Path) -> None:
    """Let this process and others that name the same folder compile each kernel in turn."""
    compile_now = Dispatcher.compile

    @cache
    def lock_of(name: str) -> FileLock:
        # A kernel may call itself with other types: one lock for each name can be taken again.
        return FileLock(folder / f"{name}.lock", thread_local=False)

    def compile_in_turn(dispatcher: Any, signature: Any) -> Any:
        name = f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}"
        # First the lock of numba, as each thread takes it: none waits for a file with the other in its hands.
        with global_compiler_lock, lock_of(name.replace("<locals>", "locals")):
            return compile_now(dispatcher, signature)

    os.register_at_fork(after_in_child=lock_of.cache_clear)  # a lock belongs to the process that made it
    Dispatcher.compile = compile_in_turn
