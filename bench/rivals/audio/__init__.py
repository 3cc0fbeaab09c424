"""The published ways of modelling an object's sound, made here to be compared with on the same truth."""
