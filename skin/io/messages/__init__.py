"""The messages of a skin, for recordings (MCAP) and topics (DDS) alike.

::

    record of a cycle ─► SkinMessages ─► topic, CDR ─► Container (MCAP) or Writer (DDS)

`record` is what a cycle leaves for another process, `definitions` the types and their encoding,
`of_skin` the messages of a skin, `clouds` what viewers draw, `diagnostics` faults.
"""
