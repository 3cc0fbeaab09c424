"""One's own mesh as a row of a table of objects: checked, copied with what it refers to, pictured."""
