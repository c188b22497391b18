"""A skin on a robot: patches on links that move, and where they sit on the model."""
