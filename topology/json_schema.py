"""The topology file as JSON Schema, for editors of TOML."""

from __future__ import annotations

from typing import Any

import msgspec

from topology.schema import File

__all__ = ["json_schema"]


def json_schema(struct: type[msgspec.Struct] = File) -> dict[str, Any]:
    """JSON Schema of a topology file (or of a `CalibrationFile`), for editors of TOML.

    Examples
    --------
    >>> json_schema()["$ref"]
    '#/$defs/File'
    """
    schema = _without_null(msgspec.json.schema(struct))
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _without_null(node: Any) -> Any:
    """TOML has no null: an optional key is one that may be absent."""
    if isinstance(node, list):
        return [_without_null(item) for item in node]
    if not isinstance(node, dict):
        return node
    node = {key: _without_null(value) for key, value in node.items() if value is not None}
    choices = [item for item in node.get("anyOf", ()) if item != {"type": "null"}]
    if len(choices) == 1:
        del node["anyOf"]
        node = {**choices[0], **node}
    return node
