"""The published ways of modelling an object's look, made here to be compared with on the same truth."""
