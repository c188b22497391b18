"""The doctor's rules about boards: missing, unknown or duplicate heartbeats, serial numbers."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from bus.configure import node_numbers
from bus.discover import Survey
from bus.finding import Finding, hex_id, some
from bus.heartbeat import FIRST_ID, PERIOD_S, heartbeat_nodes
from bus.serials import compare_serials, of_boards
from topology.wire import LAYOUTS

__all__ = ["BoardRules", "identities", "other_serials"]

PATIENCE_S = 2.5 * PERIOD_S
"""Silence after which a heartbeat is missing."""


class BoardRules:
    """The rules about the boards of one bus.

    Parameters
    ----------
    survey : Survey
    index : int
        Of the bus.
    """

    def __init__(self, survey: Survey, index: int) -> None:
        skin = survey.topology
        frames = skin.frames
        self.name = f"bus {skin.buses[index].name!r}"
        self.seconds = float(survey.listened_s[index])
        self.heard = {
            node: board for (bus, node), board in survey.boards.heard.items() if bus == index
        }
        self.nodes = node_numbers(skin)[frames.bus == index]
        """Of the frames on this bus, in their order."""
        self.expected = heartbeat_nodes(skin, index)
        layouts = frames.layout[(frames.bus == index) & (frames.part == 0)]
        own = [skin.layouts[layouts[node - 1]] in LAYOUTS.values() for node in self.expected]
        self._promised = {node for node, is_own in zip(self.expected, own, strict=True) if is_own}
        """Those with this project's frames, which send heartbeats; others may not."""

    def findings(self, gone: np.ndarray) -> Iterator[Finding]:
        """Everything about the boards of this bus.

        Parameters
        ----------
        gone : ndarray, shape (f,), bool
            Missing frames of this bus.
        """
        talking = set(self.nodes[~gone].tolist())
        missing = [node for node in self.expected if node in talking and self._misses(node)]
        yield from self._missing(missing, len(talking.intersection(self.expected)))
        for node, board in sorted(self.heard.items()):
            if node not in self.expected:
                serials = _listed(sorted(board.serials))
                yield Finding(
                    "unknown-board", "warning", self._named(node), board.heartbeats,
                    f"{some(board.heartbeats, 'heartbeat')} of a board that the file does not know "
                    f"(serial number {serials})",
                    "a board that is not in the file, or that has another node number",
                )  # fmt: skip
            if len(board.serials) > 1:
                yield Finding(
                    "duplicate-node", "error", self._named(node), len(board.serials),
                    f"heartbeats with {len(board.serials)} serial numbers "
                    f"({_listed(sorted(board.serials))})",
                    "two boards set to the same address",
                )  # fmt: skip
            if board.state == "fault":
                yield Finding(
                    "board-fault", "error", self._named(node), board.heartbeats,
                    "the board reports a fault in its heartbeats",
                    "see the board's manual; its units may be wrong though their frames come",
                )  # fmt: skip

    def alive(self, gone: np.ndarray) -> str:
        """The cause where frames are missing although the boards that send them are alive.

        Parameters
        ----------
        gone : ndarray, shape (f,), bool
            Missing frames of this bus.

        Returns
        -------
        str
            Empty where one of the boards is silent.
        """
        nodes = np.unique(self.nodes[gone]).tolist()
        if not nodes or any(node not in self.heard or self._misses(node) for node in nodes):
            return ""
        states = sorted({self.heard[node].state for node in nodes})
        who = "its board lives" if len(nodes) == 1 else f"all {len(nodes)} boards live"
        return (
            f"{who}, by heartbeat (state {' or '.join(states)}): no SYNC that reaches it, another "
            "sync_id or data identifier than the file's, or sampling that has stopped"
        )

    def are_numbered(self, silent: np.ndarray, unknown: int) -> bool:
        """Whether heartbeats can be those of silent boards (`silent`: of the frames of this bus).

        Not where boards that talk, perhaps on `unknown` identifiers, account for all of them, since
        their numbers may be others.
        """
        alive = {node for node in self.heard if not self._misses(node)}
        talking = set(self.nodes[~silent].tolist()) & (self._promised | self.heard.keys())
        idle = alive & set(self.nodes[silent].tolist())
        return len(alive) - len(talking) - unknown >= len(idle)

    def _misses(self, node: int) -> bool:
        board = self.heard.get(node)
        if board is None and node not in self._promised:
            return False
        return self.seconds - (board.last_s if board else 0.0) >= PATIENCE_S

    def _missing(self, nodes: list[int], talking: int) -> Iterator[Finding]:
        if len(nodes) == talking > 1 and not any(node in self.heard for node in nodes):
            yield Finding(
                "missing-heartbeat", "warning", self.name, len(nodes),
                f"not one heartbeat of {len(nodes)} boards in {self.seconds:.1f} s, though "
                "their data come",
                "a firmware without heartbeats, or a filter or recording that left them out",
            )  # fmt: skip
            return
        for node in nodes:
            board = self.heard.get(node)
            since = self.seconds - (board.last_s if board else 0.0)
            how = "has not come for the last" if board else "never came in"
            yield Finding(
                "missing-heartbeat", "warning", self._named(node), 1,
                f"its heartbeat {how} {since:.1f} s, though its data do",
                "a firmware of which only the sampling still runs" if board
                else "another node number than the file's, or an older firmware",
            )  # fmt: skip

    def _named(self, node: int) -> str:
        return f"node {node} ({hex_id(FIRST_ID + node)}) on {self.name}"


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


def _listed(words: Collection[object], most: int = 4) -> str:
    shown = ", ".join(str(word) for word in list(words)[:most])
    return shown if len(words) <= most else f"{shown} and {len(words) - most} more"
