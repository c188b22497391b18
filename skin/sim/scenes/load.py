"""Loads scene files and ready-made scenes, and checks their times and names against a skin.

Whether a body can be where its script puts it shows when the scene is played.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from bus.faults.script import FaultScript, problems
from skin.errors import MOST_SEED, SceneError, check_kind, check_number
from skin.sim.scenes import names
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.script import SceneFile
from topology import Topology
from topology.errors import Report, TopologyError, nearest
from topology.files import check_path, missing
from topology.read import open_source, read
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
    file: str | os.PathLike[str], topology: Topology, *, seed: int | None = None
) -> ScriptedScene:
    """Load a scene and prepare it, optionally with another seed than the file's.

    Parameters
    ----------
    file, topology
        See `load_scene`.
    seed : int, optional
        Overrides the file's.
    """
    if seed is not None:
        check_number("seed", seed, 0, MOST_SEED, whole=True)
    script = load_scene(file, topology)
    return ScriptedScene(topology, script if seed is None else replace(script, seed=seed))


def _read(file: str | os.PathLike[str], topology: Topology, report: Report) -> SceneFile | None:
    source = _open(file, report)
    script = None if source is None else read(SceneFile, source)
    if source is None or script is None:
        return None
    _check_times(script, source)
    _check_names(script, source, topology)
    faults = FaultScript(seed=script.seed, faults=script.faults)
    for i, key, hint, values in problems(faults, topology):
        source.fault(("faults", i, key), **values, hint=hint)
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
        report.about_file(shown, expected, got, hint=hint)
        return None
    return open_source(path, shown, report)


class _LoadedScene(SceneFile, frozen=True, kw_only=True):
    """A scene file with the lines of its keys."""

    source: Source

    def place(self, key: Key) -> str:
        return f"{self.source.shown}:{self.source.line(key)}: {self.source.where(key)}"


def _check_times(script: SceneFile, source: Source) -> None:
    """Times ascend, and are within the scene."""

    def must(key: Key, expected: str, got: float) -> None:
        source.fault(key, expected, f"{got:g}")

    tables: list[tuple[Key, Sequence[Any], Sequence[Any]]] = [(("room",), script.room, ())]
    for name in ("bodies", "loads", "tools"):
        for i, table in enumerate(getattr(script, name)):
            tables.append(((name, i, "keys"), table.keys, getattr(table, "waves", ())))
    for key, rows, waves in tables:
        for i, row in enumerate(rows):
            if row.t_s > script.seconds:
                end = source.line(("seconds",))
                expected = f"at most the scene's seconds, {script.seconds:g} (line {end})"
                must((*key, i, "t_s"), expected, row.t_s)
            if i and row.t_s <= rows[i - 1].t_s:
                must((*key, i, "t_s"), f"later than the key before, {rows[i - 1].t_s:g}", row.t_s)
        for i, wave in enumerate(waves):
            if wave.to_s <= wave.from_s:
                place = (*key[:-1], "waves", i, "to_s")
                must(place, f"later than from_s, {wave.from_s:g}", wave.to_s)


def _check_names(script: SceneFile, source: Source, topology: Topology) -> None:
    """Bodies and tools have names of their own, and stand on what the skin has."""
    known = (*topology.patch_names, *topology.unit_names)

    def check(key: Key, name: str, everywhere: bool) -> None:
        if not (everywhere and name == "*"):
            source.refer(name, f"a patch or unit of {topology.name!r}", known, key)

    seen: dict[str, Key] = {}
    for table in ("bodies", "tools"):
        for i, thing in enumerate(getattr(script, table)):
            key: Key = (table, i)
            if thing.name in seen:
                line = source.line((*seen[thing.name], "name"))
                got = f"{thing.name!r}, also at line {line}"
                source.fault((*key, "name"), "a name used once", got)
            seen.setdefault(thing.name, key)
            if thing.on is not None:
                check((*key, "on"), thing.on, table == "bodies")
    for i, load in enumerate(script.loads):
        for j, name in enumerate(load.units):
            check(("loads", i, "units", j), name, everywhere=True)
