"""Slow, obvious references of what the bus computes."""


def crc16(data, crc=0xFFFF):
    """CRC-16/CCITT-FALSE, one bit after the other."""
    for byte in data:
        for k in range(7, -1, -1):
            carry = ((crc >> 15) ^ (byte >> k)) & 1
            crc = ((crc << 1) & 0xFFFF) ^ (0x1021 if carry else 0)
    return crc


def bits_of(signal):
    """Places of a signal's bits as (byte, bit), least significant first."""
    if signal.order == "little":
        return [divmod(signal.start + k, 8) for k in range(signal.length)]
    byte, bit = divmod(signal.start, 8)
    places = []
    for _ in range(signal.length):  # from the most significant bit on
        places.append((byte, bit))
        byte, bit = (byte, bit - 1) if bit else (byte + 1, 7)
    return places[::-1]
