"""`skin publish`: what a skin feels as topics of ROS 2."""

from __future__ import annotations

import json as json_text
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from skin.cli import options
from skin.cli.run import AutoTare, Simulate, check_simulated, note, note_scene
from skin.cli.table import facts
from skin.cli.tally import Tally

if TYPE_CHECKING:
    from skin.io.publish import Publisher

__all__ = ["publish"]


def publish(
    file: options.File,
    /,
    *,
    seconds: options.Until = None,
    interface: options.Interface = None,
    channel: options.Channel = None,
    sync: options.Sync = "host",
    simulate: Simulate = False,
    scene: options.Scene = None,
    seed: options.Seed = None,
    auto_tare: AutoTare = True,
    prefix: Annotated[
        str, tyro.conf.arg(metavar="NAME", help="of the topics: NAME/state, NAME/wrench, …")
    ] = "skin",
    frame: Annotated[str, tyro.conf.arg(metavar="NAME", help="frame of the skin in tf")] = "skin",
    rate: Annotated[
        float, tyro.conf.arg(metavar="HZ", help="at most so many states a second; 0: every cycle")
    ] = 100.0,
    network: Annotated[
        bool, options.quiet("let the subnet see the topics, not this machine alone")
    ] = False,
    json: options.Json = False,
) -> int:  # fmt: skip
    """Listen to the buses of a topology, send SYNC, and publish what the skin feels to ROS 2.

    ROS 2 need not be installed here; the domain is ROS_DOMAIN_ID, or 0. Topics, as
    `ros2 topic list` shows them: skin/state, skin/layout, skin/wrench, skin/contact/<slot>,
    skin/points, skin/forces, /tf_static, /diagnostics (docs/guides/connect.md). With `--simulate`
    simulated units play a scene. Exits with 1 if no unit ever answered.
    """
    import skin
    from skin.io.publish import ros
    from topology import load

    options.check_seconds(seconds)
    check_simulated(simulate, scene, seed, sync, interface, channel)
    loaded = load(file).on(interface=interface, channel=channel)
    if not simulate:
        note(file, loaded, auto_tare)
    with ExitStack() as ended:
        opened = ended.enter_context(
            skin.open(loaded, sync=sync, simulate=scene or simulate, seed=seed, auto_tare=auto_tare)
        )
        node = ros(opened, prefix=prefix, frame=frame, rate_hz=rate or None, network=network)
        ended.enter_context(node)
        note_scene(opened.nodes and opened.nodes.scene)
        report = _loop(opened, node, seconds)
    print(json_text.dumps(report) if json else _table(report))
    return 0 if report["units_heard"] and report["publishing"] else 1


def _loop(opened: Any, node: Publisher, seconds: float | None) -> dict[str, Any]:
    """Publish until the time is up, Ctrl-C, or the process that publishes ends."""
    tally, end, published = Tally(opened.topology), None, 0
    try:
        for state in opened:
            tally.add(state, opened.timing.work_ns)
            if tally.cycles % 256 == 1 and not node.alive:
                break
            if end is None and seconds is not None:
                end = time.monotonic() + seconds  # from the first cycle on
            if end is not None and time.monotonic() >= end:
                break
    except KeyboardInterrupt:
        pass
    alive = node.alive
    if alive:
        published = node.sent()
    elif node.failure is None:
        node.fail()
    return tally.report() | {
        "published": published, "left_out": node.lost, "publishing": alive,
    }  # fmt: skip


def _table(report: dict[str, Any]) -> str:
    rows = {
        "units heard": "{units_heard} of {units_enabled}",
        "cycles": "{cycles}, {overruns} left out",
        "states published": "{published}, {left_out} left out",
    }
    return facts(rows, report)
