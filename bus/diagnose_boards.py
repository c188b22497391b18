"""The doctor's rules about boards: missing, unknown or duplicate heartbeats, serial numbers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bus.discover import Survey
from bus.finding import Finding, hex_id, some
from bus.heartbeat import FIRST_ID, PERIOD_S, heartbeat_nodes, node_numbers
from bus.serials import compare_serials, of_boards
from topology.wire import LAYOUTS

__all__ = ["board_findings", "identities", "other_serials"]

PATIENCE_S = 2.5 * PERIOD_S
"""Silence after which a heartbeat is missing."""


def board_findings(survey: Survey, index: int, gone: np.ndarray) -> Iterator[Finding]:
    """Everything about the boards of one bus.

    Parameters
    ----------
    survey : Survey
    index : int
        Of the bus.
    gone : ndarray, shape (f,), bool
        Missing frames of this bus.
    """
    skin, seconds = survey.topology, float(survey.listened_s[index])
    frames, on = skin.frames, f"bus {skin.buses[index].name!r}"
    heard = {node: board for (bus, node), board in survey.boards.heard.items() if bus == index}
    expected = heartbeat_nodes(skin, index)
    layouts = frames.layout[(frames.bus == index) & (frames.part == 0)]
    talking = set(node_numbers(skin)[frames.bus == index][~gone].tolist())

    def named(node: int) -> str:
        return f"node {node} ({hex_id(FIRST_ID + node)}) on {on}"

    for node in sorted(talking.intersection(expected)):
        # boards with frames of another project send heartbeats or not
        if node not in heard and skin.layouts[layouts[node - 1]] not in LAYOUTS.values():
            continue
        since = seconds - (heard[node].last_s if node in heard else 0.0)
        if since >= PATIENCE_S:
            how = "has not come for the last" if node in heard else "never came in"
            yield Finding(
                "missing-heartbeat", "warning", named(node), 1,
                f"its heartbeat {how} {since:.1f} s, though its data do",
                "a firmware of which only the sampling still runs" if node in heard
                else "another node number than the file's, or a firmware without heartbeats",
            )  # fmt: skip
    for node, board in sorted(heard.items()):
        numbers = sorted(board.serials)
        serials = ", ".join(map(str, numbers[:4])) + (", …" if len(numbers) > 4 else "")
        if node not in expected:
            yield Finding(
                "unknown-board", "warning", named(node), board.heartbeats,
                f"{some(board.heartbeats, 'heartbeat')} of a board that the file does not know "
                f"(serial number {serials})",
                "a board that is not in the file, or that has another node number",
            )  # fmt: skip
        if len(numbers) > 1:
            yield Finding(
                "duplicate-node", "error", named(node), len(numbers),
                f"heartbeats with {len(numbers)} serial numbers ({serials})",
                "two boards set to the same address",
            )  # fmt: skip
        if board.state == "fault":
            yield Finding(
                "board-fault", "error", named(node), board.heartbeats,
                "the board reports a fault in its heartbeats",
                "see the board's manual; its units may be wrong though their frames come",
            )  # fmt: skip


def identities(survey: Survey) -> dict[str, str]:
    """Units whose serial number is in their calibration file and in heartbeats; and what is wrong
    with it, if anything."""
    skin = survey.topology
    given = {name: serial for name, serial in zip(skin.unit_names, skin.serials, strict=False)}
    heard = of_boards(skin, survey.boards)
    return compare_serials(given, heard, given, "the calibration file")


def other_serials(survey: Survey) -> Iterator[Finding]:
    """Units with the calibration of another unit."""
    for name, wrong in identities(survey).items():
        if wrong:
            yield Finding(
                "other-serial", "error", name, 1, wrong,
                "boards that were exchanged, or set to each other's address: its readings are "
                "decoded with the constants of another unit",
            )  # fmt: skip
