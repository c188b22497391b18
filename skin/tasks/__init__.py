"""Tasks: behaviours composed to stories by a small file, with the stages, people and things of the
simulator that they are played with.
"""
