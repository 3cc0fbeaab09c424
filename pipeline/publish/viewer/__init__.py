"""Object Files in a browser: `live` asks the file itself, `static` needs nothing but the page."""

# Of a data set: what was made of Object Files for players, by their content; losing it costs time only.
PLAYERS = ".objectfolder/players"
