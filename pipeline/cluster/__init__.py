"""Where tasks run: places started or joined, and how tasks run there."""
