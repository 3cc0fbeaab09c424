"""The table of failures under its former name."""

from pipeline.failure_table import failure_table

__all__ = ["failure_table"]
