"""What the data set is for: learning tasks on Object Files, by the public API of `objectfolder` alone."""
