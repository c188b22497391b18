"""`skin publish`: what a skin feels as topics of ROS 2."""

from __future__ import annotations

from contextlib import ExitStack, suppress

from skin.cli import options
from skin.cli.table import end
from skin.cli.tally import Tally

__all__ = ["publish"]


def publish(
    file: options.File,
    /,
    *,
    seconds: options.Until = None,
    bus: options.Bus = None,
    sync: options.Sync = "host",
    simulate: options.Simulate = None,
    prefix: str = "skin",
    rate: float = 100.0,
    network: bool = False,
    json: options.Json = False,
) -> int:
    """Listen to the buses of a topology, send SYNC, and publish what the skin feels to ROS 2.

    ROS 2 need not be installed here; the domain is ROS_DOMAIN_ID of the environment, or 0. Topics,
    as `ros2 topic list` shows them: skin/state, skin/layout, skin/wrench, skin/contact/<slot>,
    skin/points, skin/forces, /tf, /diagnostics (docs/guides/connect.md). With `--simulate`
    simulated units play a scene. Exits with 1 if no unit ever answered.

    Parameters
    ----------
    prefix
        of the topics, NAME/state, …, and of the frame in tf
    rate
        at most so many states a second; 0: every cycle
    network
        let the subnet see the topics, not this machine alone
    """
    from skin.io.publish import ros

    options.check_seconds(seconds)
    with ExitStack() as ended:
        opened = ended.enter_context(options.open_skin(file, bus=bus, sync=sync, simulate=simulate))
        tally = Tally(opened.topology)
        node = ended.enter_context(
            ros(
                opened,
                prefix=prefix,
                frame=prefix.strip("/"),
                rate_hz=rate or None,
                network=network,
            )
        )
        with suppress(KeyboardInterrupt):  # also where the process that publishes has ended
            tally.follow(opened, seconds, goes_on=lambda: node.alive)
        alive = node.alive
        published = node.sent() if alive else 0
        if not alive and node.failure is None:
            node.fail()
    report = tally.report() | {
        "published": published, "left_out": node.lost, "publishing": alive,
    }  # fmt: skip
    end(report, json)
    return 0 if report["units_heard"] and alive else 1
