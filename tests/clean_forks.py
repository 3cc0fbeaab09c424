"""Processes forked from one that has a single thread.

A fork of the tests' own process has the locks that its other threads, as those of Dask, held at that moment.
"""

import multiprocessing

CLEAN = multiprocessing.get_context("forkserver")
CLEAN.set_forkserver_preload(["pipeline.intake.add.addition"])
