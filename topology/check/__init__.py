"""Rules of a topology file: each room checks one kind of part and gives back what is sound."""
