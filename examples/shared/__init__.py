"""What the figures of the paper have in common: a simulated gripper, people, vessels."""
