"""Tasks: behaviours at work on the simulator, with what people, weights and flames do to it."""
