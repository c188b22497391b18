"""Recordings of runs as MCAP files, and their replay to the same states, bit for bit.

::

    loop     Pipeline ─► RecordedPipeline ─► Recorder ─► ring buffer
    worker   ring buffer ─► SkinMessages ─► Container ─► run.mcap
    replay   run.mcap ─► events in their order ─► Pipeline ─► states

A file holds what the pipeline was given, in its order (frames, cycles that the clock closed, new
poses), and what came of it, as messages that every reader of MCAP with the profile ros2 knows.
"""
