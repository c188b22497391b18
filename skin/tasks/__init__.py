"""Tasks: behaviours played on the simulator, with the people and the things that they deal with."""
