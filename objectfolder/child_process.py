"""What a process started for native code does first: make sure that it does not outlive its parent."""

import contextlib
import ctypes
import os
import signal
import threading
import time

PR_SET_PDEATHSIG = 1
CHECK_INTERVAL_S = 1.0


def end_with(parent: int) -> None:
    """End this process when the process `parent`, which started it, ends, whatever is being computed.

    Linux's kernel does it at once; elsewhere a thread looks every second.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(CHECK_INTERVAL_S)
        os._exit(1)

    if os.getppid() != parent:
        os._exit(1)
    threading.Thread(target=watch, daemon=True).start()
