"""Tasks: behaviours composed to stories by a small file, and the stages, people and things that they
are played with on the simulator."""
