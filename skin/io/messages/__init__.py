"""The messages of a skin, for recordings (MCAP) and topics (DDS) alike.

::

    record of a cycle ─► SkinMessages ─► topic, CDR ─► Container (MCAP) or Writer (DDS)

`definitions` has their fields, `record` the input of a cycle, `encode` states and wrenches, `scene`
poses and markers, `diagnostics` faults.
"""
