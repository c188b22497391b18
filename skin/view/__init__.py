"""What a person sees: a live table in the terminal, pictures of a run."""
