"""One run of toys against a store that fails at random by a seed, then an undisturbed one to finish it."""

import contextlib
import errno
import hashlib
import os
import random
import shutil
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any
from unittest import mock

import http_faults
import s3_server
from store_runs import elsewhere, flow, made
from toys import Toys, here

from objectfolder.errors import ObjectFolderError
from pipeline.dataset import products
from pipeline.dataset.task import Call, Outcome
from pipeline.sandbox.child import execute
from pipeline.store import shared, shipping
from pipeline.store.storage import PATIENCE, STORE, product_name

READ_TIMEOUT_S, LATE_S, PATIENCE_S = 0.5, 0.8, 3.0
REMOTE, CACHE = "workers elsewhere", "store as a cache"


class Trials:
    """Runs of one set of toys, each with a bucket of its own.

    Parameters
    ----------
    toys
        The objects and stages.
    server
        Address of an S3 server.
    folder
        For the workers' cache and scratch files.
    """

    def __init__(self, toys: Toys, server: str, folder: Path) -> None:
        self.toys = toys
        self._server = server
        self._folder = folder
        self._finished: Counter[str] = Counter()
        self._wipe()
        with self._environment("", server):  # no store
            toys.converge()
        toys.executed()
        self.expected = made(toys)
        self._stored = {
            product_name(products.read_fingerprint(path), products.kind_name(path)): self.expected[name]
            for name in self.expected
            for path in [toys.root / name]
        }

    def run(self, seed: int) -> dict[str, Any]:
        """Disturb one run, finish the work with another, and return what was seen as plain data."""
        chance = random.Random(seed)
        mode = chance.choice((REMOTE, REMOTE, CACHE))
        rate = chance.uniform(0.05, 0.4)
        proxy = http_faults.Proxy(self._server, rate, seed, LATE_S)
        full = chance.choice((0.0, 0.0, chance.uniform(0.02, 0.2)))  # share of writes that find the disk full
        outage = (chance.randrange(10, 80), chance.randrange(1, 60)) if chance.random() < 0.3 else (0, 0)
        proxy.outage = range(outage[0], sum(outage))
        self._wipe()
        bucket = s3_server.new_bucket(self._server)
        before = time.monotonic()
        with http_faults.standing_before(proxy) as address, self._environment(f"s3://{bucket}", address):
            self._finished.clear()
            with disk_full(full, seed) as missed:
                errors = self._once(mode)
            seconds = time.monotonic() - before
            torn = self._torn(bucket)
            first = made(self.toys)
            proxy.rate, proxy.outage = 0.0, range(0)
            shared._cache_at.cache_clear()
            shipping._store.cache_clear()
            with unhurried():
                again = self._once(mode)
            torn_later = self._torn(bucket)
        return {
            "seed": seed,
            "mode": mode,
            "fault_rate": round(rate, 3),
            "requests": sum(proxy.requests.values()),
            "faults": dict(proxy.faults),
            "refused": proxy.refusals,
            "writes_without_space": missed[0],
            "errors": errors,
            "seconds": round(seconds, 2),
            "wrong_after_first": sum(self.expected.get(name) != content for name, content in first.items()),
            "torn_in_store": torn + torn_later,
            "missing_after_first": len(self.expected) - len(first),
            "errors_of_second": again,
            "equal_after_second": made(self.toys) == self.expected,
            "executions": len(self.toys.executed()),
            "finished": len(self._finished),
            "finished_again": sum(self._finished.values()) - len(self._finished),
            "left_half_written": len(list(self.toys.root.glob("data/*/.*"))),
        }

    def _once(self, mode: str) -> list[str]:
        """Run all stages; return why objects failed, or the error that ended the run."""
        try:
            runner_for = elsewhere(self.toys.root, self._execute) if mode == REMOTE else here
            with mock.patch("toys.execute", self._execute):
                summaries = flow(self.toys, runner_for)
            return [
                f"{failure.error}. {failure.remedy}"
                for summary in summaries
                for failure in summary.failures
                if "input missing" not in failure.error
            ]
        except ObjectFolderError as error:
            return [str(error)]
        except OSError as error:
            traceback.print_exc()
            return [f"ended by {type(error).__name__}: {error}"]

    def _execute(self, call: Call) -> Outcome:
        outcome = execute(call)
        if outcome.failure is None:
            self._finished[f"{call.stage} {call.request.object_id}"] += 1
        return outcome

    def _torn(self, bucket: str) -> int:
        """Number of objects in the store that are not what their name promises."""
        objects = s3_server.contents(self._server, bucket)
        return sum(
            hashlib.sha256(content).hexdigest() != name.rpartition("/")[2]
            if name.startswith("sources/")
            else self._stored.get(name) != content
            for name, content in objects.items()
        )

    def _wipe(self) -> None:
        shared._cache_at.cache_clear()
        shipping._store.cache_clear()
        for folder in (self.toys.root / "data", self.toys.root / ".objectfolder", self._folder / "cache"):
            shutil.rmtree(folder, ignore_errors=True)

    @contextlib.contextmanager
    def _environment(self, url: str, address: str) -> Iterator[None]:
        settings = {
            **s3_server.environment(address),
            STORE: url,
            PATIENCE: str(PATIENCE_S),
            "OBJECTFOLDER_CACHE": str(self._folder / "cache"),
        }
        timeouts = {"connect_timeout": "5s", "read_timeout": f"{READ_TIMEOUT_S}s"}
        with (
            mock.patch.dict(os.environ, settings),
            mock.patch("pipeline.store.storage.TIMEOUTS", timeouts),
            mock.patch.dict("pipeline.store.storage.PAUSES", {"init_backoff": timedelta(seconds=0.02)}),
        ):
            yield


@contextlib.contextmanager
def unhurried() -> Iterator[None]:
    """Let an undisturbed run wait for a machine that is busy with other things."""
    timeouts = {"connect_timeout": "60s", "read_timeout": "60s"}
    with (
        mock.patch.dict(os.environ, {PATIENCE: "120"}),
        mock.patch("pipeline.store.storage.TIMEOUTS", timeouts),
    ):
        yield


@contextlib.contextmanager
def disk_full(share: float, seed: int) -> Iterator[list[int]]:
    """Let a share of all files find no space when they are to be made safe; count them."""
    chance, count, sync = random.Random(seed), [0], os.fsync

    def fsync(descriptor: int) -> None:
        if chance.random() < share:
            count[0] += 1
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(descriptor)

    with mock.patch("os.fsync", fsync):
        yield count


def is_right(outcome: dict[str, Any]) -> bool:
    """Whether a trial is as it has to be: all bytes right, nothing torn, nothing finished made again."""
    return bool(
        outcome["equal_after_second"]
        and not outcome["errors_of_second"]
        and not outcome["wrong_after_first"]
        and not outcome["torn_in_store"]
        and not outcome["left_half_written"]
        and not outcome["finished_again"]
        and (outcome["errors"] or not outcome["missing_after_first"])
        and not any(error.startswith("ended by") for error in outcome["errors"])
    )
