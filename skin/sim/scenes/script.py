"""Scene files, format version 1: bodies on a skin, with times, forces and temperatures.

::

    format = 1
    seconds = 10.0

    [[bodies]]
    name = "ball"
    shape = { kind = "sphere", radius_m = 0.05 }
    friction = 0.5
    keys = [
        { t_s = 0.0, xyz_m = [0.0, 0.0, 0.003] },
        { t_s = 1.0, xyz_m = [0.0, 0.0, -0.001] },
    ]

The coordinates of a body are in the frame of the patch or unit that it is `on`, the largest patch
if none is named: x along the units' x, z out of the skin, the origin at the middle of the patch at
the height of its outermost face. With `only_on` it touches no unit of another patch, wherever these
stand, so that one scene fits hands of any form. `xyz_m` is the lowest point of the body before it
is rotated by `rpy_deg` about its own origin. With `press_n` the body is sunk until the skin bears
that load, and not held at a height; with `drag_n` it is dragged, and not held, along x and y. Each
quantity is interpolated between the keys that name it, and constant before the first and after the
last. With `repeat` the scene starts again at its end, and a body that is on `"*"` moves to the next
patch. Unnamed quantities do nothing.

`[[loads]]` are weights glued to units, `[[tools]]` spheres of iron that pass by, `[[room]]` the air
and the attitude of the skin in the field of the Earth. `[non_ideal]` switches on single effects of
real units that the paper's formulas leave out.
`skin check --schema scene` prints all of it as a JSON Schema.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import msgspec
from msgspec import Meta

from bus.faults.script import FaultScript
from skin.physics.surroundings import Tool

__all__ = [
    "BodyTable",
    "Key",
    "LoadKey",
    "LoadTable",
    "NonIdeal",
    "RoomKey",
    "SceneFile",
    "Shape",
    "ToolKey",
    "ToolTable",
    "Wave",
]

_Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$(?!\n)", max_length=64)]
_Seconds = Annotated[float, Meta(ge=0, le=86_400)]
_Length = Annotated[float, Meta(ge=1e-4, le=10)]
_Coordinate = Annotated[float, Meta(ge=-10, le=10)]
_Angle = Annotated[float, Meta(ge=-36_000, le=36_000)]
_Force = Annotated[float, Meta(ge=-1000, le=1000)]
_Press = Annotated[float, Meta(ge=0, le=1000)]
_Celsius = Annotated[float, Meta(ge=-50, le=200)]
_Friction = Annotated[float, Meta(ge=0, le=10)]
_Moment = Annotated[float, Meta(ge=-100, le=100)]
_Point = tuple[_Coordinate, _Coordinate, _Coordinate]
_Turn = tuple[_Angle, _Angle, _Angle]
_Ease = Literal["smooth", "linear", "hold"]


class _Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file without unknown keys."""


class _Shape(_Table, frozen=True, kw_only=True, tag_field="kind"):
    """Shape of a body."""


class Sphere(_Shape, frozen=True, kw_only=True, tag="sphere"):
    """A sphere about the origin of the body."""

    radius_m: _Length


class Cylinder(_Shape, frozen=True, kw_only=True, tag="cylinder"):
    """A cylinder that lies along x."""

    radius_m: _Length
    length_m: _Length


class Block(_Shape, frozen=True, kw_only=True, tag="block"):
    """A block of these edges."""

    x_m: _Length
    y_m: _Length
    z_m: _Length


class Plate(_Shape, frozen=True, kw_only=True, tag="plate"):
    """A flat face; the origin in its middle."""

    x_m: _Length
    y_m: _Length


Shape = Sphere | Cylinder | Block | Plate


class Key(_Table, frozen=True, kw_only=True):
    """State of a body at one instant (`keys` of `[[bodies]]`); other quantities are
    interpolated."""

    t_s: Annotated[_Seconds, Meta(description="Later than the key before")]
    ease: Annotated[
        _Ease,
        Meta(description="Way from the key before: minimum jerk, steady, or a jump at its end"),
    ] = "smooth"
    xyz_m: Annotated[_Point | None, Meta(description="Lowest point of the unturned body")] = None
    rpy_deg: Annotated[_Turn | None, Meta(description="About its origin, convention of URDF")] = (
        None
    )
    press_n: Annotated[_Press | None, Meta(description="Into the skin, along -z; 0: lifted")] = None
    drag_n: Annotated[tuple[_Force, _Force] | None, Meta(description="Along x and y")] = None
    temperature_c: Annotated[_Celsius | None, Meta(description="Of the body")] = None
    friction: Annotated[_Friction | None, Meta(description="In place of that of the body")] = None


class Wave(_Table, frozen=True, kw_only=True):
    """A sine added to the keys (`waves` of `[[bodies]]`): amplitudes of quantities."""

    from_s: _Seconds
    to_s: _Seconds
    frequency_hz: Annotated[float, Meta(ge=1e-3, le=100)]
    xyz_m: _Point | None = None
    rpy_deg: _Turn | None = None
    press_n: _Press | None = None
    drag_n: tuple[_Force, _Force] | None = None


class BodyTable(_Table, frozen=True, kw_only=True):
    """A body (`[[bodies]]`)."""

    name: _Name
    shape: Shape
    keys: Annotated[tuple[Key, ...], Meta(min_length=1)]
    waves: tuple[Wave, ...] = ()
    on: Annotated[
        str | None,
        Meta(
            description="Patch or unit in whose frame it stands; absent: the largest patch; `*`: "
            "every patch, the next one with each repetition of the scene"
        ),
    ] = None
    only_on: Annotated[
        bool, Meta(description="Only units of that patch can touch it: others are out of its way")
    ] = False
    friction: Annotated[_Friction, Meta(description="Coefficient at rest")] = 0.5
    friction_share: Annotated[
        float, Meta(ge=1e-3, le=1, description="Coefficient in motion over that at rest")
    ] = 1.0
    compliance_mm_per_n: Annotated[
        float, Meta(ge=0, le=100, description="How far it yields to the force of one unit")
    ] = 0.0


class LoadKey(_Table, frozen=True, kw_only=True):
    """Forces at one instant (`keys` of `[[loads]]`)."""

    t_s: Annotated[_Seconds, Meta(description="Later than the key before")]
    ease: _Ease = "smooth"
    force_n: Annotated[
        tuple[_Force, _Force, _Press] | None,
        Meta(description="On each of the units, unit frame; z into the skin"),
    ] = None
    temperature_c: Annotated[_Celsius | None, Meta(description="Of what loads the units")] = None


class LoadTable(_Table, frozen=True, kw_only=True):
    """Weights glued to the faces of units (`[[loads]]`): without friction or other units."""

    units: Annotated[
        tuple[str, ...], Meta(min_length=1, description="Units, patches, or `*`: all of them")
    ]
    keys: Annotated[tuple[LoadKey, ...], Meta(min_length=1)]


class ToolKey(_Table, frozen=True, kw_only=True):
    """A tool at one instant (`keys` of `[[tools]]`)."""

    t_s: Annotated[_Seconds, Meta(description="Later than the key before")]
    ease: _Ease = "smooth"
    xyz_m: Annotated[_Point, Meta(description="Lowest point of the sphere")]


class ToolTable(_Table, frozen=True, kw_only=True):
    """A sphere of iron that passes by (`[[tools]]`): it acts on chips, not on faces."""

    name: _Name
    keys: Annotated[tuple[ToolKey, ...], Meta(min_length=1)]
    on: Annotated[
        str | None,
        Meta(description="Patch or unit in whose frame it stands; absent: the largest patch"),
    ] = None
    radius_m: Annotated[float, Meta(ge=1e-4, le=0.1)] = Tool.radius_m
    permeability: Annotated[float, Meta(ge=1, le=1e6, description="Relative")] = Tool.permeability
    remanent_am2: Annotated[
        tuple[_Moment, _Moment, _Moment],
        Meta(description="Moment that it keeps without any field, A m², in the frame"),
    ] = Tool.remanent_am2


class RoomKey(_Table, frozen=True, kw_only=True):
    """The room at one instant (`[[room]]`)."""

    t_s: Annotated[_Seconds, Meta(description="Later than the key before")]
    ease: _Ease = "smooth"
    temperature_c: Annotated[_Celsius | None, Meta(description="Of the air")] = None
    attitude_deg: Annotated[
        _Turn | None, Meta(description="Roll, pitch and yaw of the skin in the world")
    ] = None


class NonIdeal(_Table, frozen=True, kw_only=True):
    """Effects of real units that the paper's formulas leave out (`[non_ideal]`), one by one."""

    noise: Annotated[bool, Meta(description="Of each sample, as in the unit's model")] = True
    viscoelastic: Annotated[bool, Meta(description="Creep and relaxation of the elastomer")] = False
    hysteresis: Annotated[bool, Meta(description="Loops of the elastomer, 5 % wide")] = False
    thermal: Annotated[
        bool, Meta(description="Heat takes its way through film and elastomer, and is lost on it")
    ] = False
    magnet: Annotated[
        bool,
        Meta(
            description="Field of the Halbach film; else, without what else acts on it, the sine "
            "law"
        ),
    ] = True
    fabrication: Annotated[bool, Meta(description="Errors of Halbach films, from the seed")] = False
    crosstalk: Annotated[bool, Meta(description="Halbach films of the neighbours")] = True
    ambient_field: Annotated[bool, Meta(description="The field of the Earth as the skin turns")] = (
        False
    )

    @classmethod
    def everything(cls) -> NonIdeal:
        """All of them."""
        return cls(**dict.fromkeys(cls.__struct_fields__, True))

    @classmethod
    def only(cls, *names: str) -> NonIdeal:
        """None but these."""
        return cls(**{**dict.fromkeys(cls.__struct_fields__, False), **dict.fromkeys(names, True)})


if TYPE_CHECKING:
    _Faults = tuple[Any, ...]
else:
    _Faults = get_type_hints(FaultScript, include_extras=True)["faults"]


class SceneFile(_Table, frozen=True, kw_only=True):
    """The whole file."""

    format: Literal[1]
    seconds: Annotated[float, Meta(ge=1e-3, le=86_400, description="How long it lasts")]
    repeat: Annotated[
        bool, Meta(description="Start again at its end; otherwise keep the last state")
    ] = False
    name: str = ""
    description: str = ""
    seed: Annotated[int, Meta(ge=0, description="Of noise, fabrication and faults")] = 0
    non_ideal: NonIdeal = NonIdeal()
    room: tuple[RoomKey, ...] = ()
    bodies: tuple[BodyTable, ...] = ()
    loads: tuple[LoadTable, ...] = ()
    tools: tuple[ToolTable, ...] = ()
    faults: _Faults = ()

    @property
    def period_s(self) -> float:
        """Period of the scene; infinite without repetition."""
        return self.seconds if self.repeat else math.inf

    def where(self, table: str, index: int, time_s: float) -> str:
        """A body, load or tool at a time, for messages: by the next key.

        Parameters
        ----------
        table : "bodies", "loads" or "tools"
        index : int
        time_s : float
        """
        keys = getattr(self, table)[index].keys
        within_s = time_s % self.period_s
        key = min(bisect_left([key.t_s for key in keys], within_s), len(keys) - 1)
        return f"{self.place((table, index, 'keys', key))} (at {time_s:.4g} s)"

    def place(self, key: tuple[str | int, ...]) -> str:
        """A key for messages; one from a file begins with file and line."""
        table, index, *rest = key
        name = getattr(getattr(self, str(table))[index], "name", None)
        words = f"{table}[{index}]" + (f" {name!r}" if name else "")
        return f"{words} {rest[0]}[{rest[1]}]" if rest else words
