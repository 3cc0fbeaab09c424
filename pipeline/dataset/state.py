"""Paths of files beside a data set and outside its versions; losing them costs time only."""

STATE = ".objectfolder"
PLAYERS = f"{STATE}/players"  # what was made of Object Files for players, by their content
