"""Tasks: behaviours composed to stories, by a small file, and the stages that they are played on."""
