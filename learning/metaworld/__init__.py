"""Meta-World with objects of the factory in place of its own, in an environment of its own."""
