"""Two versions of the data set compared, one checked, the history of an object; nothing is checked out."""
