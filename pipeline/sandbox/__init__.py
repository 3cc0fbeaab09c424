"""The processes that task bodies run in: bounded, watched, never left behind."""
