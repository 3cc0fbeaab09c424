"""Products beyond the data folder: in DVC's cache, in a store at any URL, and jobs sent through it."""
