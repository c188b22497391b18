"""Tasks: behaviours composed to stories by a small file, and the stages they are played on."""
