"""Paths of files beside a data set and outside its versions; losing them costs time only."""

STATE = ".objectfolder"
PLAYERS = f"{STATE}/players"  # data of players, by the content of the Object File
