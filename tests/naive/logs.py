"""Logs of candump -L read line by line with one expression: slow, and plain to see."""

import re

from bus.frame import CAN_EFF, CAN_RTR, ECHO, FD_FDF

LINE = re.compile(
    rb"[ \t]*\((?P<seconds>\d+)\.(?P<fraction>\d{1,9})\)[ \t]+"
    rb"(?P<name>[!-~]{1,63})[ \t]+"
    rb"(?P<id>[\dA-Fa-f]{3}|[\dA-Fa-f]{8})#"
    rb"(?:#(?P<flags>[\dA-Fa-f])(?P<fd>(?:[\dA-Fa-f]{2}){0,64})"
    rb"|[Rr](?P<remote>[0-8]?)|(?P<data>(?:[\dA-Fa-f]{2}){0,8}))"
    rb"(?P<code>_[\dA-Fa-f])?(?:[ \t]+(?P<way>[RrTt]))?[ \t]*\r?"
)
BLANK = re.compile(rb"[ \t]*\r?")
DETAIL = re.compile(rb"\t+[a-z][ -~]*\r?")
WHOLE = re.compile(rb".*(#[\dA-Fa-f]{16}(_[\dA-Fa-f])?|##[\dA-Fa-f]{129}|[ \t][RrTt])\s*", re.S)
LATEST_S = 2**63 // 10**9 - 1


def candump(text):
    """Read a log.

    Returns
    -------
    rows : list of tuple
        As `logfixtures.rows` gives them, with the interface's name in place of the bus.
    bad : list of int
        Lines that are wrong, from 1.
    """
    rows, bad = [], []
    *lines, rest = text.split(b"\n")
    for number, line in enumerate(lines, 1):
        if not BLANK.fullmatch(line):
            row = _row(line)
            if row is not None:
                rows.append(row)
            elif not DETAIL.fullmatch(line):
                bad.append(number)
    if rest.strip():
        row = _row(rest) if WHOLE.fullmatch(rest) else None
        if row is not None:
            rows.append(row)
        elif b"#" in rest or not DETAIL.fullmatch(rest):
            bad.append(len(lines) + 1)
    return rows, bad


def _row(line):
    match = LINE.fullmatch(line)
    if match is None:
        return None
    can_id, flags, data, length = int(match["id"], 16), 0, b"", None
    if can_id > (0x7FF if len(match["id"]) == 3 else 0x3FFFFFFF):
        return None
    if len(match["id"]) != 3:
        can_id |= CAN_EFF if can_id <= 0x1FFFFFFF else 0
    if match["flags"]:
        flags = int(match["flags"], 16) & 3 | FD_FDF
        data = bytes.fromhex(match["fd"].decode())
    elif match["data"] is not None:
        data = bytes.fromhex(match["data"].decode())
    else:
        can_id |= CAN_RTR
        length = int(match["remote"] or b"0")
    length = len(data) if length is None else length
    seconds = int(match["seconds"])
    if seconds > LATEST_S or (match["code"] and length != 8):
        return None
    stamp_ns = 10**9 * seconds + int(match["fraction"].ljust(9, b"0"))
    origin = ECHO if match["way"] in (b"T", b"t") else 0
    return stamp_ns, can_id, length, flags, origin, match["name"], data
