"""Where tasks run: places started or joined, and the crews that run tasks there."""
