"""Scene files: what touches a skin and when; ready-made ones are the `*.toml` beside."""
