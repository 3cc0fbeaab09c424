"""Published collections of objects, and the download of their files: resumed, checked, whole."""
