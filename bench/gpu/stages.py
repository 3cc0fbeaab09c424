"""How long each kernel of a query takes."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from bench.gpu.run import LEARNED, Run, objects, touches


def stages(run: Run, work: Callable[[], Any]) -> dict[str, float]:
    """Milliseconds of each kernel, and of the networks of sight, synchronised after each."""
    from objectfolder.batch import elastic, known_sight, learned_sight, shear, sight_surfaces
    from objectfolder.batch.targets import Body

    figures: dict[str, float] = {}

    def timed(name: str, plain: Callable[..., Any], *arguments: Any) -> Any:
        if not run.on_cpu:
            run.torch.cuda.synchronize()
        begin = time.perf_counter()
        answer = plain(*arguments)
        if not run.on_cpu:
            run.torch.cuda.synchronize()
        figures[name] = round(figures.get(name, 0.0) + 1e3 * (time.perf_counter() - begin), 3)
        return answer

    call = Body.__call__
    parts = {
        "network": (learned_sight.Network, "answer"),
        "bounced": (known_sight.KnownSight, "bounced"),
        "hits": (sight_surfaces, "hits"),
        "displacement": (elastic.Layer, "displacement"),
        "sideways": (shear.Compliance, "displacement"),
    }
    plain = {name: getattr(*part) for name, part in parts.items()}
    work()
    # Types do not allow a method to be replaced; it is put back below.
    Body.__call__ = lambda body, *arguments: timed(body.name, call, body, *arguments)  # type: ignore[method-assign]
    for name, part in parts.items():
        setattr(*part, lambda *arguments, name=name: timed(name, plain[name], *arguments))
    try:
        timed("all", work)
    finally:
        Body.__call__ = call  # type: ignore[method-assign]
        for name, part in parts.items():
            setattr(*part, plain[name])
    return figures


def touch_stages(run: Run) -> dict[str, Any]:
    from objectfolder.batch import Batch

    files = objects()
    batch = Batch(files, run.device).touch
    count = run.batches[-1]
    which, points, settings = touches(count, files)
    return {"touches": count, "milliseconds": stages(run, lambda: batch.press(which, points, **settings))}


def sight_stages(run: Run, names: Sequence[str] = LEARNED) -> dict[str, Any]:
    from objectfolder.batch import Batch

    file, count = objects(names)[0], 2 if run.on_cpu else 1024
    views = file.sample_views(count, seed=5, lit=True)
    cameras, lights = (run.torch.as_tensor(part, device=run.device) for part in views)
    batch = Batch([file], run.device).sight
    return {"views": count, "milliseconds": stages(run, lambda: batch.render(0, cameras, lights, 128))}
