"""What a run will take, from measured costs and in virtual time."""
