"""What lies beside a data set and outside its versions; losing it costs time only."""

STATE = ".objectfolder"
PLAYERS = f"{STATE}/players"  # what was made of Object Files for players, by their content
