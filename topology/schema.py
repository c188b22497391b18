"""The topology file, format version 1, as frozen structs.

A file is TOML. `json_schema` describes it to editors; `topology/builtin/palm.toml` is the
commented example. Lengths are metres and angles degrees, and every name says so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_type_hints

import msgspec
from msgspec import Meta

from topology.model import UnitModel
from topology.wire import Factor, LayoutFields, WireLayout

__all__ = [
    "Bus",
    "Cylinder",
    "Dome",
    "File",
    "Frame",
    "Grid",
    "Hex",
    "Layout",
    "List",
    "ListUnit",
    "Model",
    "Override",
    "Parameters",
    "Patch",
    "Pose",
    "Robot",
    "Scale",
    "Table",
    "json_schema",
]

Name = Annotated[
    str,
    Meta(
        pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$(?!\n)",
        max_length=64,
        description="Letters, digits, `_`, `-` and `.`",
    ),
]
FARTHEST_M, WIDEST_M = 5.0, 0.5
"""Of a place and of a radius, and of units next to each other [assumed: the longest arms reach
4.7 m, a unit is some millimetres wide]. What is more is likely meant in millimetres."""
_Far = Annotated[float, Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
Coordinate = Annotated[float, Meta(ge=-1000, le=1000)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
"""A direction, of any length."""
Place = tuple[_Far, _Far, _Far]
Angle = Annotated[float, Meta(ge=-36_000, le=36_000)]
Radius = Annotated[float, Meta(ge=1e-6, le=FARTHEST_M)]
Pitch = Annotated[float, Meta(ge=1e-6, le=WIDEST_M)]
Count = Annotated[int, Meta(ge=1, le=100_000)]
Identifier = Annotated[int, Meta(ge=0, le=0x1FFFFFFF)]


class Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file without unknown keys."""


class Bus(Table, frozen=True, kw_only=True):
    """One CAN bus (`[[buses]]`)."""

    name: Name
    interface: Annotated[
        str,
        Meta(description="`memory` (in-process), `socketcan`, or any interface of python-can"),
    ]
    channel: Annotated[str, Meta(description="Channel of the interface, e.g. `can0`")] = ""
    bitrate: Annotated[int, Meta(ge=1000, le=1_000_000, description="Nominal bit rate, bit/s")] = (
        1_000_000
    )
    data_bitrate: Annotated[
        Annotated[int, Meta(ge=1000, le=20_000_000)] | None,
        Meta(description="CAN FD data bit rate, bit/s; absent: classic CAN"),
    ] = None
    max_load: Annotated[
        float, Meta(ge=0.01, le=1, description="Share of the bus that worst-case bits may fill")
    ] = 0.8
    options: Annotated[
        dict[str, Any], Meta(description="Further keyword arguments of the python-can interface")
    ] = {}

    @property
    def fd(self) -> bool:
        """Whether the bus carries CAN FD frames."""
        return self.data_bitrate is not None


class Pose(Table, frozen=True, kw_only=True):
    """Pose of a frame or a patch in its parent: rotated first, then translated."""

    xyz_m: Annotated[Place, Meta(description="Origin in the parent, metres")] = (0.0, 0.0, 0.0)
    rpy_deg: Annotated[
        tuple[Angle, Angle, Angle] | None,
        Meta(description="Roll, pitch, yaw about the parent's fixed x, y, z, degrees (as in URDF)"),
    ] = None
    quaternion_wxyz: Annotated[
        tuple[float, float, float, float] | None,
        Meta(description="Unit quaternion, w first, in place of `rpy_deg`"),
    ] = None


class Frame(Table, frozen=True, kw_only=True):
    """A named frame (`[[frames]]`); the root is `skin` and needs no table."""

    name: Name
    parent: Annotated[str, Meta(description="`skin` or another frame of the file")] = "skin"
    link: Annotated[
        str | None, Meta(description="Link of the robot's model, in place of `parent`")
    ] = None
    pose: Pose = Pose()


class Robot(Table, frozen=True, kw_only=True):
    """The robot that carries the skin (`[robot]`)."""

    model: Annotated[str, Meta(description="URDF (.urdf) or MJCF (.xml), relative to this file")]
    base: Annotated[
        str | None,
        Meta(description="Link whose frame is `skin`; absent: the model's root"),
    ] = None
    home: Annotated[
        dict[str, Annotated[float, Meta(ge=-1000, le=1000)]],
        Meta(
            description="Joint to radians or metres, until joints are reported; absent: 0 or the "
            "model's reference, within the limits"
        ),
    ] = msgspec.field(default_factory=dict)


class Scale(Table, frozen=True, kw_only=True):
    """Physical value = scale * integer + offset, for the units of a model."""

    scale: Factor
    offset: Factor = 0.0


if TYPE_CHECKING:

    class Parameters(Table, frozen=True, kw_only=True):
        """Replaced below, for type checkers, which do not know classes made at run time."""

else:
    Parameters = msgspec.defstruct(
        "Parameters",
        [
            (name, kind | None, None)
            for name, kind in get_type_hints(UnitModel, include_extras=True).items()
        ],
        bases=(Table,),
        frozen=True,
        kw_only=True,
        module=__name__,
    )

Parameters.__doc__ = "Any parameters of `UnitModel`; an absent one (None) is left as it is."


class Model(Parameters, frozen=True, kw_only=True):
    """A user's unit model (`[[models]]`): a base and its differences."""

    name: Name
    base: Annotated[str, Meta(description="A built-in model, or one further up in the file")] = (
        "f3t-paper"
    )
    scales: Annotated[
        dict[str, Scale],
        Meta(description="Channel to {scale, offset}, in place of the wire layout's own"),
    ] = msgspec.field(default_factory=dict)


class Layout(LayoutFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A user's wire layout (`[[layouts]]`): its bits, or a message of a DBC file."""

    size: Annotated[
        Annotated[int, Meta(ge=1, le=64)] | None,
        Meta(description="Bytes of each frame; a DBC says it itself"),
    ] = None
    fd: Annotated[
        bool | None,
        Meta(description="CAN FD frames; absent: what the DBC says, or false"),
    ] = None
    dbc: Annotated[
        str | None, Meta(description="DBC file that has the layout, relative to this file")
    ] = None
    message: Annotated[str | None, Meta(description="Name of its message in the DBC file")] = None
    dbc_signals: Annotated[
        dict[str, str | tuple[str, ...]],
        Meta(
            description="Channel or field to the name of its signal in the message: one with "
            "`{slot}` (from 0) or `{slot+1}` in it, or a list, where a frame carries several units"
        ),
    ] = msgspec.field(default_factory=dict)

    def wire(self, **known: Any) -> WireLayout:
        """What it is on a bus, with the fields that are known by now in place of its own."""
        own = {name: getattr(self, name) for name in WireLayout.__struct_fields__}
        return WireLayout(**own | known)


class _Patch(Table, frozen=True, kw_only=True, tag_field="kind"):
    name: Name
    bus: Annotated[str, Meta(description="Name of the bus that the units hang on")]
    layout: Annotated[
        str,
        Meta(
            description="`f3t-classic`, `f3t-fd16`, `f3t-fd64`, one of `[[layouts]]`, or a foreign "
            "one that gives counts only: `xela-uskin`, `icub-skin`"
        ),
    ]
    model: Annotated[str, Meta(description="`f3t-paper` or one of `[[models]]`")] = "f3t-paper"
    frame: Annotated[str, Meta(description="Frame that `pose` is given in")] = "skin"
    link: Annotated[
        str | None, Meta(description="Link of the robot's model, in place of `frame`")
    ] = None
    pose: Annotated[Pose, Meta(description="Patch frame in `frame` or `link`")] = Pose()
    extended: Annotated[bool, Meta(description="Identifiers are 29-bit ones")] = False
    calibration: Annotated[
        str | None, Meta(description="Calibration file, relative to this file")
    ] = None


class _Numbered(_Patch, frozen=True, kw_only=True):
    first_id: Annotated[
        Identifier,
        Meta(
            description="Identifier of the first frame; the next ones follow in the order of the "
            "units: another number of them moves the identifiers of all behind"
        ),
    ]


class Grid(_Numbered, frozen=True, kw_only=True, tag="grid"):
    """Flat, square: columns along x, rows along y, middle in the origin, outward normal +z."""

    rows: Count
    columns: Count
    pitch_m: Annotated[Pitch, Meta(description="Distance of neighbours in a row, metres")]
    row_pitch_m: Annotated[
        Pitch | None, Meta(description="Distance of the rows; absent: `pitch_m`")
    ] = None


class Hex(_Numbered, frozen=True, kw_only=True, tag="hex"):
    """Flat, hexagonal: a grid whose odd rows are moved half a pitch along x."""

    rows: Count
    columns: Count
    pitch_m: Annotated[Pitch, Meta(description="Distance of nearest neighbours, metres")]


class Cylinder(_Numbered, frozen=True, kw_only=True, tag="cylinder"):
    """A grid or hexagonal grid bent about an axis along y, at z = -radius."""

    radius_m: Annotated[Radius, Meta(description="Radius of the cylinder, metres")]
    rows: Annotated[Count, Meta(description="Rows along the axis")]
    columns: Annotated[Count, Meta(description="Columns around the axis")]
    pitch_m: Annotated[Pitch, Meta(description="Distance of neighbours along the arc, metres")]
    row_pitch_m: Annotated[
        Pitch | None,
        Meta(description="Distance of the rows; absent: `pitch_m`, or hexagonal if staggered"),
    ] = None
    stagger: Annotated[bool, Meta(description="Move odd rows half a pitch: hexagonal")] = False


class Dome(_Numbered, frozen=True, kw_only=True, tag="dome"):
    """A spherical cap: one unit on top, in the origin, and rings around it.

    Ring k has 6 k units, or fewer where the sphere has less room for the distance of the rings:
    with r rings at most 1 + 3 r (r + 1) units (7, 19, 37, 61, …). `skin check` prints their number.
    """

    radius_m: Annotated[Radius, Meta(description="Radius of the sphere, metres")]
    rings: Annotated[
        int,
        Meta(
            ge=0,
            le=1000,
            description="Rings around the middle unit, the k-th of 6 k units, or of as many as "
            "keep the straight distance of the rings: 7, 19, 37, 61, … units in all, at most",
        ),
    ]
    pitch_m: Annotated[Pitch, Meta(description="Distance of the rings along the arc, metres")]


class ListUnit(Table, frozen=True, kw_only=True):
    """One unit of a list (`[[patches.units]]`)."""

    xyz_m: Annotated[Place, Meta(description="Middle of the sensing face, patch frame, metres")]
    normal: Annotated[Vector, Meta(description="Outward normal, patch frame, any length")]
    x_axis: Annotated[
        Vector | None,
        Meta(
            description="Direction of the unit's x axis, made square to the normal; absent: x of "
            "the patch frame, or its y where x is nearly the normal"
        ),
    ] = None
    name: Annotated[Name | None, Meta(description="Absent: its number in the list, from 0")] = None
    id: Annotated[
        Identifier | None, Meta(description="Identifier of its frame, in place of `first_id`")
    ] = None
    slot: Annotated[
        Annotated[int, Meta(ge=0, le=31)] | None,
        Meta(description="Place in the frame, from 0; only with `id`"),
    ] = None


class List(_Patch, frozen=True, kw_only=True, tag="list"):
    """Units placed one by one."""

    units: Annotated[tuple[ListUnit, ...], Meta(min_length=1)]
    first_id: Annotated[
        Identifier | None,
        Meta(description="Identifier of the first frame; absent where every unit names its own"),
    ] = None


Patch = Union[Grid, Hex, Cylinder, Dome, List]  # noqa: UP007 - evaluated by msgspec at run time


class Override(Parameters, frozen=True, kw_only=True):
    """What differs for one unit (`[[overrides]]`); any parameter of its model is allowed."""

    unit: Annotated[str, Meta(description="Patch and unit, e.g. `palm/r3c4`")]
    enabled: Annotated[bool, Meta(description="False: the unit is left out everywhere")] = True
    model: Annotated[str | None, Meta(description="Another model than its patch's")] = None
    offset_m: Annotated[
        Place, Meta(description="Moves it from its nominal place, patch frame, metres")
    ] = (0.0, 0.0, 0.0)
    id: Annotated[Identifier | None, Meta(description="Another frame than its turn gives")] = None
    slot: Annotated[
        Annotated[int, Meta(ge=0, le=31)] | None,
        Meta(description="Place in the frame, from 0; only with `id`"),
    ] = None


class File(Table, frozen=True, kw_only=True):
    """A topology file."""

    format: Annotated[Literal[1], Meta(description="Version of the file format")]
    name: Annotated[Name, Meta(description="Name of the skin")]
    description: str = ""
    cycle_rate_hz: Annotated[
        float, Meta(ge=0.1, le=100_000, description="Cycles a second, on all buses")
    ] = 250.0
    sync_id: Annotated[
        Annotated[int, Meta(ge=0, le=0x7FF)] | None,
        Meta(description="Identifier of SYNC on all buses; absent: units send freely"),
    ] = None
    robot: Robot | None = None
    buses: Annotated[tuple[Bus, ...], Meta(min_length=1, max_length=256)]
    frames: Annotated[tuple[Frame, ...], Meta(max_length=2000)] = ()
    models: Annotated[tuple[Model, ...], Meta(max_length=1000)] = ()
    layouts: Annotated[tuple[Layout, ...], Meta(max_length=1000)] = ()
    patches: Annotated[tuple[Patch, ...], Meta(min_length=1, max_length=2000)]
    overrides: tuple[Override, ...] = ()


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
