"""ObjectFolder Factory: what an object looks, sounds and feels like, in one small file."""

__version__ = "0.1.0"
