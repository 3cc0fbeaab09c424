"""The published ways of modelling an object's feel, made here to be compared with on the same truth."""
