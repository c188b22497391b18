"""Obvious, slow references of what `topology` computes cleverly."""

import numpy as np

CRC15, CRC17, CRC21 = (15, 0x4599), (17, 0x1685B), (21, 0x102899)
FD_CODES = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)


def number_bits(value, width):
    return [value >> i & 1 for i in reversed(range(width))]


def byte_bits(data):
    return [bit for byte in data for bit in number_bits(byte, 8)]


def crc_bits(bits, crc, start=0):
    width, polynomial = crc
    register = start
    for bit in bits:
        carry = register >> (width - 1) ^ bit
        register = register << 1 & ((1 << width) - 1)
        if carry & 1:
            register ^= polynomial
    return number_bits(register, width)


def stuffed(bits):
    """Bits as they are sent: after five equal ones a contrary one, which counts for the next."""
    sent = []
    run = 0
    for bit in bits:
        run = run + 1 if sent and sent[-1] == bit else 1
        sent.append(bit)
        if run == 5:
            sent.append(1 - bit)
            run = 1
    return sent


def identifier_bits(can_id, extended, last):
    """From the start of frame to the IDE or RTR/RRS bit, which stand in another order by format."""
    if extended:
        return [0, *number_bits(can_id >> 18, 11), 1, 1, *number_bits(can_id & 0x3FFFF, 18), last]
    return [0, *number_bits(can_id, 11), last, 0]


def classic_frame(can_id, data, extended=False):
    """Bits of a classic data frame on the wire, the three of intermission included."""
    control = [0, 0] if extended else [0]
    head = identifier_bits(can_id, extended, 0) + control + number_bits(len(data), 4)
    body = head + byte_bits(data)
    return stuffed(body + crc_bits(body, CRC15)) + [1] * 13


def fd_frame(can_id, data, extended=False):
    """Bits of a CAN FD data frame at the nominal and at the data bit rate."""
    arbitration = [*identifier_bits(can_id, extended, 0), 1, 0, 1]  # FDF, res, BRS
    body = [0, *number_bits(FD_CODES.index(len(data)), 4), *byte_bits(data)]
    whole = stuffed(arbitration + body)
    if len(stuffed(arbitration + body[:-1])) + 2 == len(whole):
        whole.pop()  # a fixed stuff bit stands where this one would
    slow = stuffed(arbitration)
    stuff_count = (len(whole) - len(arbitration) - len(body)) % 8
    gray = number_bits(stuff_count ^ stuff_count >> 1, 3)
    count = [*gray, sum(gray) % 2]
    crc = CRC17 if len(data) <= 16 else CRC21
    # ISO: the register starts with a one in front, and takes dynamic stuff bits in.
    check = count + crc_bits(whole + count, crc, start=1 << (crc[0] - 1))
    fixed = []
    for i, bit in enumerate(check):
        if i % 4 == 0:
            fixed.append(1 - (fixed[-1] if fixed else whole[-1]))
        fixed.append(bit)
    return slow + [1] * 13, whole[len(slow) :] + fixed


def pairs_within(position, radius):
    n = position.shape[1]
    return {
        (i, j)
        for i in range(n)
        for j in range(i + 1, n)
        if np.linalg.norm(position[:, i] - position[:, j]) <= radius
    }
