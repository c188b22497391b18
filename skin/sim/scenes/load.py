"""Loads scene files and ready-made scenes, and checks them against a skin."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from bus.faults.script import FaultScript, problems
from skin.errors import (
    MOST_SEED,
    SceneError,
    SkinError,
    check_flag,
    check_kind,
    check_number,
)
from skin.physics.elastic import Elastic
from skin.sim.mechanics.contact import Mechanics
from skin.sim.scenes import names
from skin.sim.scenes.motion import Motion, largest_patch, shape_of
from skin.sim.scenes.play import DEEPEST_MM, ScriptedScene, loaded_units
from skin.sim.scenes.script import BodyTable, LoadTable, SceneFile
from skin.sim.scenes.tools import MovingTool
from topology import Topology
from topology.errors import TopologyError, nearest
from topology.files import check_path, missing
from topology.read import open_source, read
from topology.report import Report
from topology.source import Key, Source

__all__ = ["load_scene", "open_scene"]


def load_scene(file: str | os.PathLike[str], topology: Topology) -> SceneFile:
    """Load a scene file, and check it against the skin that plays it.

    Parameters
    ----------
    file : str or path
        A file, or the name of a ready-made scene (`skin.sim.scenes.names`).
    topology : Topology

    Returns
    -------
    SceneFile

    Raises
    ------
    SceneError
        With every problem of the file, each with its line.

    Examples
    --------
    >>> from topology import load
    >>> load_scene("press", load("palm")).bodies[0].name
    'ball'
    """
    check_kind("topology", topology, Topology)
    report = Report()
    script = None
    with suppress(TopologyError):  # more than a report holds
        script = _read(file, topology, report)
    if script is None or report.issues:
        issues = sorted(report.issues, key=lambda issue: issue.line)
        raise SceneError("\n".join(map(str, issues)))
    return script


def open_scene(
    file: str | os.PathLike[str], topology: Topology, *, seed: int | None = None, noise: bool = True
) -> ScriptedScene:
    """Load a scene and prepare it, optionally with other noise than the file's.

    Parameters
    ----------
    file, topology
        See `load_scene`.
    seed : int, optional
        Overrides the file's.
    noise : bool
        False: without noise.
    """
    if seed is not None:
        check_number("seed", seed, 0, MOST_SEED, whole=True)
    check_flag("noise", noise)
    script = load_scene(file, topology)
    wanted = replace(script.non_ideal, noise=noise and script.non_ideal.noise)
    return ScriptedScene(
        topology, replace(script, seed=script.seed if seed is None else seed, non_ideal=wanted)
    )


def _read(file: str | os.PathLike[str], topology: Topology, report: Report) -> SceneFile | None:
    source = _open(file, report)
    if source is None:
        return None
    script = read(SceneFile, source, report)
    if report.issues:
        return None
    _Check(script, source, topology, report).all()
    values = {name: getattr(script, name) for name in SceneFile.__struct_fields__}
    values["name"] = script.name or source.path.stem
    return _LoadedScene(**values, source=source)


def _open(file: str | os.PathLike[str], report: Report) -> Source | None:
    check_path("file", file, SceneError)
    shown = os.fspath(file)
    if shown in names:
        path = Path(__file__).with_name(f"{shown}.toml")
        return open_source(path, path.name, report)
    path = Path(file)
    if missing(path):
        hint = "" if path.suffix or path.name != shown else nearest(shown, names, or_all=False)
        expected, got = f"a file or a ready-made scene ({', '.join(names)})", "no such file"
        report.about_file("value", shown, hint=hint, expected=expected, got=got)
        return None
    return open_source(path, shown, report)


class _LoadedScene(SceneFile, frozen=True, kw_only=True):
    """A scene file with the lines of its keys."""

    source: Source

    def place(self, key: Key) -> str:
        return f"{self.source.shown}:{self.source.line(key)}: {self.source.where(key)}"


class _Check:
    """Checks that need the topology, or other keys."""

    def __init__(
        self, script: SceneFile, source: Source, topology: Topology, report: Report
    ) -> None:
        self.script, self.source, self.topology, self.report = script, source, topology, report

    def all(self) -> None:
        script = self.script
        self.rows(("room",), script.room, ())
        for name in ("bodies", "loads", "tools"):
            for i, table in enumerate(getattr(script, name)):
                self.rows((name, i, "keys"), table.keys, getattr(table, "waves", ()))
        self.names()
        self.faults()
        if not self.report.issues:
            for i, body in enumerate(script.bodies):
                self.place(i, body)
            for i in range(len(script.tools)):
                self.tool(i)
            for i, load in enumerate(script.loads):
                self.load(i, load)

    def must(self, key: Key, expected: str, got: object, hint: str = "") -> None:
        self.report.add("value", self.source, key, hint, expected=expected, got=got)

    def rows(self, key: Key, keys: Sequence[Any], waves: Sequence[Any]) -> None:
        """Time is ascending, and within the scene."""
        for i, row in enumerate(keys):
            if row.t_s > self.script.seconds:
                end = self.source.line(("seconds",))
                expected = f"at most the scene's seconds, {self.script.seconds:g} (line {end})"
                self.must((*key, i, "t_s"), expected, f"{row.t_s:g}")
            if i and row.t_s <= keys[i - 1].t_s:
                expected = f"later than the key before, {keys[i - 1].t_s:g}"
                self.must((*key, i, "t_s"), expected, f"{row.t_s:g}")
        for i, wave in enumerate(waves):
            if wave.to_s <= wave.from_s:
                place = (*key[:-1], "waves", i, "to_s")
                self.must(place, f"later than from_s, {wave.from_s:g}", f"{wave.to_s:g}")

    def names(self) -> None:
        topology, source = self.topology, self.source
        known = (*topology.patch_names, *topology.unit_names)
        seen: dict[str, Key] = {}
        things = [(("bodies", i), body) for i, body in enumerate(self.script.bodies)]
        things += [(("tools", i), tool) for i, tool in enumerate(self.script.tools)]
        for key, thing in things:
            if thing.name in seen:
                line = source.line((*seen[thing.name], "name"))
                self.report.add(
                    "duplicate-name", source, (*key, "name"), name=repr(thing.name), line=line
                )
            seen.setdefault(thing.name, key)
            anywhere = known if key[0] == "tools" else (*known, "*")
            if thing.on is not None and thing.on not in anywhere:
                self.unknown((*key, "on"), thing.on, known)
        for i, load in enumerate(self.script.loads):
            for j, name in enumerate(load.units):
                if name not in (*known, "*"):
                    self.unknown(("loads", i, "units", j), name, known)

    def unknown(self, key: Key, name: str, known: Sequence[str]) -> None:
        kind = f"a patch or unit of {self.topology.name!r}"
        self.report.add(
            "unknown-name", self.source, key, nearest(name, known), kind=kind, name=repr(name)
        )

    def faults(self) -> None:
        script = FaultScript(seed=self.script.seed, faults=self.script.faults)
        for i, key, hint, values in problems(script, self.topology):
            self.report.add("value", self.source, ("faults", i, key), hint, **values)

    def tool(self, index: int) -> None:
        """A tool has a possible place."""
        tool = MovingTool(self.script, index, self.topology)
        for i, key in enumerate(self.script.tools[index].keys):
            if problem := tool.problem(key.t_s):
                hint = self.standing(self.script.tools[index].on)
                self.must(("tools", index, "keys", i, "xyz_m"), *problem, hint)
                return

    def load(self, index: int, table: LoadTable) -> None:
        """Weights press no unit deeper than a body may."""
        units = loaded_units(table.units, self.topology)
        most_n = Elastic(self.topology).normal(DEEPEST_MM)[units].min()
        for i, key in enumerate(table.keys):
            if key.force_n is not None and key.force_n[2] > most_n:
                expected = f"at most {most_n:.4g}, which presses a unit {DEEPEST_MM:g} mm"
                self.must(("loads", index, "keys", i, "force_n", 2), expected, key.force_n[2])

    def place(self, index: int, table: BodyTable) -> None:
        """A body is outside of the array, or pressed into it within the range of units."""
        places = self.topology.patch_names if table.on == "*" else (table.on,)
        for name in places:
            self.body(index, replace(table, on=name))

    def standing(self, on: str | None) -> str:
        """The frame of an object, as the end of a message."""
        if on is None:
            return f"; its frame is that of {largest_patch(self.topology)!r}, for want of 'on'"
        return f"; its frame is that of {on!r}"

    def on_robot(self) -> str:
        """Hint for units around a body, as on fingers, as the end of a message."""
        if self.topology.robot is None:
            return ""
        return "; between the fingers of a robot, bodies are those of `skin.sim.grasp`"

    def body(self, index: int, table: BodyTable) -> None:
        motion = Motion(table, self.topology, 20.0)
        inward = -motion.frame(0.0)[0][:, 2]
        body = shape_of(table.shape, table.compliance_mm_per_n)
        for i, key, time_s in _instants(table):
            pose = motion.pose(time_s)
            press_n = motion.press_n(time_s)
            mechanics = Mechanics(self.topology, body)
            mechanics.passed = motion.passed(0.0)
            where = ("bodies", index, "keys", i, key)
            try:
                if not motion.pressed:
                    depth_mm = mechanics.step(time_s, pose).displacement_mm[2]
                elif press_n > 0.0:
                    depth_mm = mechanics.push(time_s, pose, press_n, inward).displacement_mm[2]
                else:
                    continue
            except SkinError:
                expected = "a force that the skin can bear where the body is"
                self.must(where, expected, press_n, self.standing(table.on))
                return
            if not depth_mm.max() <= DEEPEST_MM:
                unit = self.topology.unit_names[int(np.argmax(depth_mm))]
                self.must(
                    where,
                    f"a body outside of the array, at most {DEEPEST_MM:g} mm into any unit",
                    f"{depth_mm.max():.3g} mm into {unit}",
                    self.standing(table.on) + self.on_robot(),
                )
                return


def _instants(table: BodyTable) -> Iterator[tuple[int, str, float]]:
    """Keys that set the place or the load of a body: index, field and time."""
    for i, key in enumerate(table.keys):
        for name in ("press_n", "xyz_m", "rpy_deg"):
            if getattr(key, name) is not None:
                yield i, name, key.t_s
                break
