"""A skin on a robot: patches on moving links, and their places on the model."""
