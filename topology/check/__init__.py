"""Rules of a topology file: each file checks one kind of part and returns the valid ones."""
