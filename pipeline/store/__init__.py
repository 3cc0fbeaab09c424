"""Products beyond the data folder: the memo, the store at any URL behind it, and jobs sent through it."""
