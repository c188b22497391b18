"""The messages of a skin, once, for recordings (MCAP) and topics (DDS).

::

    record of a cycle ─► SkinMessages ─► topic, CDR ─► Container (MCAP) or Writer (DDS)

`definitions` has their fields, `record` what a cycle hands over, `encode` states and wrenches,
`scene` poses and markers, `diagnostics` what is wrong.
"""
