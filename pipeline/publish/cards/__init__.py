"""What a data set is published with: cards for people and machines, and single objects fetched from it."""
