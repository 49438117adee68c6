"""`fipa hiac encode | decode` against the codec written here: tools.py FIPA SEED"""

import json
import random
import subprocess
import sys

from wire import *

NAMES = {SIG: "SIG", SMPH: "SMPH", MSG: "MSG", SHMW: "SHMW", SHMR: "SHMR", SYNC: "SYNC", SYS: "SYS"}
MASKS = [None, 0xFF, 0x3F00, 0x0FFF00, 0xFFFFFFFF, 0x3]


def tool(fipa, command, mask, octets):
    words = [fipa, "hiac", command] + ([] if mask is None else ["--mask", written(mask)])
    ended = subprocess.run(words, input=octets, capture_output=True, timeout=60)
    return ended.stdout, ended.returncode


def shown_address(number, full, mask):
    return written(number) if full else f"{level_of(number, mask):X}"


def as_json(packet, mask):
    data, shown = packet.data, {
        "type": NAMES.get(packet.type, packet.type),
        "priority": packet.priority,
        "confirm": packet.confirm,
        "check": "crc32" if packet.crc else "sum",
        "full-addressing": packet.full,
    }
    if packet.psn is not None:
        fragment, data = data[0], data[1:]
        more = fragment & 0x80 != 0
        shown |= {"psn": packet.psn, "fragment": {"index": fragment & 0x7F, "more": more}}
    for key in ("target", "source"):
        shown[key] = shown_address(getattr(packet, key), packet.full, mask)
    return shown | {"data": data.hex()}


def random_packet(chance, mask):
    full = mask is None or chance.random() < 0.5
    numbered = chance.random() < 0.5
    length = chance.choice([0, 1, 2, 20, 126, 127, 128, 300, 17000])
    data = chance.randbytes(length)
    if chance.random() < 0.3:
        data = bytes(0xF8 | octet & 7 for octet in data)
    places = [chance.getrandbits(32) & (0xFFFFFFFF if full else mask) for _ in range(2)]
    return Packet(
        chance.randrange(16), chance.randrange(8), numbered and chance.random() < 0.5,
        chance.random() < 0.5, full, chance.randrange(256) if numbered else None, *places,
        (chance.randbytes(1) if numbered else b"") + data)


def encode(fipa, chance, mask):
    packets = [random_packet(chance, mask) for _ in range(60)]
    lines = "".join(json.dumps(as_json(packet, mask)) + "\n" for packet in packets)
    octets, code = tool(fipa, "encode", mask, lines.encode())
    wanted = b"".join(escaped(body(packet, mask)) for packet in packets)
    assert (octets, code) == (wanted, 0), (mask, code)
    return wanted


def expected(octets, mask):
    """The lines of `decode`."""
    reader, lines = Reader(), []
    cut = list(reader.feed(octets)) + list(reader.finish())
    for packet, fault in cut:
        if fault is None and not packet:
            lines.append({"type": "ALIVE"})
            continue
        try:
            if fault is not None:
                raise Unreadable(fault)
            lines.append(as_json(read_body(packet, mask, 0), mask))
        except Unreadable as error:
            lines.append({"error": str(error), "octets": packet.hex()})
    return lines


def decode(fipa, octets, mask):
    shown, code = tool(fipa, "decode", mask, octets)
    lines = [json.loads(line) for line in shown.splitlines()]
    wanted = expected(octets, mask)
    for line, want in zip(lines, wanted):
        assert line == want, f"{line}\n{want}"
    assert len(lines) == len(wanted), (len(lines), len(wanted))
    assert code == any("error" in line for line in wanted), code
    return [line.get("error") for line in wanted]


def damaged(chance, octets):
    """Octets flipped, dropped, put in, and codes among them."""
    out = bytearray()
    for octet in octets:
        dice = chance.random()
        if dice < 0.002:
            out.append(octet ^ 1 << chance.randrange(8))
        elif dice < 0.004:
            out += bytes([chance.choice([START, END, EXCH, 0xFA, 0xFF, 0x00]), octet])
        elif dice > 0.002 * 3:
            out.append(octet)
    return bytes(out)


def forged(chance, mask):
    """Packets with right checks and wrong fields."""
    packet = body(random_packet(chance, mask)._replace(data=chance.randbytes(6)), mask)
    head = bytearray(packet[:-4] if packet[1] & 2 else packet[:-1])
    head[chance.randrange(len(head))] = chance.randrange(256)
    crc = len(head) > 1 and head[1] & 2
    tail = struct.pack(">I", zlib.crc32(head)) if crc else bytes([sum(head) & 0xFF])
    return escaped(bytes(head) + tail)


def main(fipa, seed):
    chance, seen = random.Random(int(seed)), set()
    for mask in MASKS:
        octets = encode(fipa, chance, mask)
        assert set(decode(fipa, octets, mask)) == {None}
        seen |= set(decode(fipa, damaged(chance, octets), mask))
        forgery = b"".join(forged(chance, mask) for _ in range(300))
        seen |= set(decode(fipa, forgery, mask))
        seen |= set(decode(fipa, chance.randbytes(20_000), mask))
    seen |= set(decode(fipa, octets + bytes([START]) + b"\x11" * 70_000, mask))
    seen |= set(decode(fipa, octets[:200], None))
    words = {"length", "version", "flags", "mask", "checksum", "address", "unfinished", "too-long"}
    assert seen == words | {None}, seen


if __name__ == "__main__":
    main(*sys.argv[1:])
