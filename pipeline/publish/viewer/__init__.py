"""Object Files in a browser: `live` asks the file itself, `static` needs nothing but the page."""

# Of what `pipeline.publish.viewer.bake` stores. Raise it when that changes: kept players of another format
# are made anew.
FORMAT = 8
