"""What a run will take, from measured costs."""
