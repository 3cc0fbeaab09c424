"""Cameras, light, and images of an Object File."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.vision.cameras import look_at
    from objectfolder.vision.environment import Environment
    from objectfolder.vision.lamps import Lamps
    from objectfolder.vision.visionnet.sight_queries import SightQueries
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "cameras": ["look_at"],
            "environment": ["Environment"],
            "lamps": ["Lamps"],
            "visionnet.sight_queries": ["SightQueries"],
        },
        {"objectfolder.making": ["simulate_views"]},
    )

__all__ = ["Environment", "Lamps", "SightQueries", "look_at"]
