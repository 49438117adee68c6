"""EDCP and HIACP written a second time, to run against the programs: codec and link."""

import collections
import queue
import socket
import struct
import threading
import time
import zlib

SIG, SMPH, MSG, SHMW, SHMR, SYNC, SYS = 1, 2, 3, 4, 5, 8, 14
PKGCNF, INCON, ACCON, REFCON, RECON, EMPTRF, WKGTRF, EMPREQ = range(1, 9)
INFORMATION, COMMAND, QUESTION, ANSWER, WARNING = range(5)

START, END, EXCH = 0xF8, 0xF9, 0xFC
PATIENCE = 15.0

# The octets of a packet that was read, and its fields.
Packet = collections.namedtuple("Packet", "type priority confirm crc full psn target source data")


class Unreadable(Exception):
    """A packet that cannot be read; its word is the message."""


def address(text):
    return int(text.replace(":", ""), 16)


def written(number):
    return ":".join(f"{octet:02X}" for octet in number.to_bytes(4, "big"))


def mask_bits(mask):
    low = (mask & -mask).bit_length() - 1
    return low, (mask >> low).bit_length()


def level_of(number, mask):
    return (number & mask) >> mask_bits(mask)[0]


def length_octets(length):
    groups = [length & 0x7F]
    while length := length >> 7:
        groups.insert(0, length & 0x7F | 0x80)
    return bytes(groups)


def escaped(octets):
    out = bytearray([START])
    for octet in octets:
        if octet >= 0xF8:
            out += bytes([EXCH, octet & 7 | 0xC8])
        else:
            out.append(octet)
    out.append(END)
    return bytes(out)


def body(packet, mask):
    """The octets of a packet before EDCP; addresses are whole ones also where levels are sent."""
    flags = packet.priority << 4 | packet.confirm << 3 | packet.crc << 1 | packet.full
    flags |= (packet.psn is not None) << 2
    octets = bytes([0x10 | packet.type, flags])
    if packet.psn is not None:
        octets += bytes([packet.psn])
    for number in (packet.target, packet.source):
        if packet.full:
            octets += number.to_bytes(4, "big")
        else:
            octets += level_of(number, mask).to_bytes((mask_bits(mask)[1] + 7) // 8, "big")
    octets += length_octets(len(packet.data)) + packet.data
    if packet.crc:
        return octets + struct.pack(">I", zlib.crc32(octets))
    return octets + bytes([sum(octets) & 0xFF])


def read_body(octets, mask, base):
    """The packet of these octets; level addresses are those of the subnetwork of `base`."""
    if len(octets) < 2:
        raise Unreadable("length")
    if octets[0] >> 4 != 1:
        raise Unreadable("version")
    flags = octets[1]
    confirm, numbered, crc, full = (bool(flags & bit) for bit in (8, 4, 2, 1))
    if flags & 0x80 or confirm and not numbered:
        raise Unreadable("flags")
    if not full and mask is None:
        raise Unreadable("mask")
    width = 4 if full else (mask_bits(mask)[1] + 7) // 8
    at = 2 + numbered
    psn = octets[2] if numbered and len(octets) > 2 else None
    target, source = octets[at:at + width], octets[at + width:at + 2 * width]
    at += 2 * width
    length, groups = 0, 0
    while True:
        if at >= len(octets) or groups == 3:
            raise Unreadable("length")
        octet = octets[at]
        at, groups = at + 1, groups + 1
        if groups == 1 and octet == 0x80:
            raise Unreadable("length")
        length = length << 7 | octet & 0x7F
        if not octet & 0x80:
            break
    check = 4 if crc else 1
    if at + length + check != len(octets) or numbered and length == 0:
        raise Unreadable("length")
    head, tail = octets[:-check], octets[-check:]
    wanted = struct.pack(">I", zlib.crc32(head)) if crc else bytes([sum(head) & 0xFF])
    if tail != wanted:
        raise Unreadable("checksum")
    numbers = []
    for field in (target, source):
        number = int.from_bytes(field, "big")
        if not full:
            low, bits = mask_bits(mask)
            if number >> bits:
                raise Unreadable("address")
            number = base & ~((1 << low + bits) - 1) & 0xFFFFFFFF | number << low
        numbers.append(number)
    return Packet(octets[0] & 15, flags >> 4, confirm, crc, full, psn, *numbers, octets[at:at + length])


class Reader:
    """Octets as they come, cut into packets."""

    def __init__(self, limit=65536):
        self.limit, self.packet, self.exchanged, self.over = limit, None, False, False

    def feed(self, octets):
        """Packets as (octets, whether finished and not too long); an empty one says alive."""
        for octet in octets:
            yield from self.take(octet)

    def take(self, octet):
        if self.packet is None:
            if octet == START:
                self.packet = bytearray()
            return
        if self.exchanged:
            self.exchanged = False
            if octet >> 3 == 0b11001:
                yield from self.put(octet & 7 | 0xF8)
                return
        if octet == EXCH:
            self.exchanged = True
        elif octet == START:
            if not self.over:
                yield bytes(self.packet), "unfinished"
            self.packet, self.over = bytearray(), False
        elif octet == END:
            if not self.over:
                yield bytes(self.packet), None
            self.packet, self.over = None, False
        elif octet < 0xF8:
            yield from self.put(octet)

    def put(self, octet):
        if self.over:
            return
        if len(self.packet) == self.limit:
            self.over = True
            yield bytes(self.packet), "too-long"
        else:
            self.packet.append(octet)

    def finish(self):
        if self.packet is not None and not self.over:
            yield bytes(self.packet), "unfinished"


def tag(number, value):
    return bytes([number, len(value)]) + value


def tags_of(data):
    """The subtype and the parameters of a SYS packet."""
    found, at = {}, 1
    while at < len(data):
        found.setdefault(data[at], data[at + 2:at + 2 + data[at + 1]])
        at += 2 + data[at + 1]
    return data[0], found


def message(kind, text=b"", reference=0):
    return bytes([kind, reference]) + text


def shown(octets):
    return " ".join(f"{octet:02X}" for octet in octets)


class Link:
    """A stream to a program: what it sends is kept, repetitions of what was confirmed are not."""

    def __init__(self, place, mask=0xFF, base=0):
        host, port = place.rsplit(":", 1)
        self.socket = socket.create_connection((host, int(port)), timeout=PATIENCE)
        self.socket.settimeout(0.05)
        self.mask, self.base = mask, base
        self.alive, self.signs, self.ended = False, 0, threading.Event()
        self.confirmations, self.waiting, self.repeated = {}, {}, 0
        self.came, self.numbers = queue.Queue(), {}
        self.lock = threading.Lock()
        threading.Thread(target=self.work, daemon=True).start()

    def work(self):
        reader, spoke = Reader(), time.monotonic()
        while True:
            if self.alive and time.monotonic() - spoke > 0.2:
                spoke = time.monotonic()
                self.write(bytes([START, END]))
            try:
                octets = self.socket.recv(4096)
            except TimeoutError:
                continue
            except OSError:
                octets = b""
            if not octets:
                self.ended.set()
                return
            for packet, fault in reader.feed(octets):
                assert fault is None, fault
                if packet:
                    self.take(packet)
                else:
                    self.signs += 1

    def take(self, octets):
        packet = read_body(octets, self.mask, self.base)
        with self.lock:
            if packet.confirm:
                key = packet.target, packet.source, packet.priority
                if self.waiting.get(key) == octets:
                    self.repeated += 1
                    if key in self.confirmations:
                        self.write(self.confirmations[key])
                    return
                self.waiting[key] = octets
                self.confirmations.pop(key, None)
        self.came.put((octets, packet))

    def write(self, octets):
        try:
            self.socket.sendall(octets)
        except OSError:
            self.ended.set()

    def send(self, packet):
        self.write(escaped(body(packet, self.mask)))

    def number(self, target, priority):
        key = target, priority
        self.numbers[key] = (self.numbers.get(key, -1) + 1) % 256
        return self.numbers[key]

    def next(self, what):
        try:
            return self.came.get(timeout=PATIENCE)[1]
        except queue.Empty:
            raise AssertionError(f"nothing came in place of {what}") from None

    def expect(self, packet, what):
        """Exactly these octets come next."""
        wanted = body(packet, self.mask)
        try:
            octets, _ = self.came.get(timeout=PATIENCE)
        except queue.Empty:
            raise AssertionError(f"{what}: nothing came in place of {shown(wanted)}") from None
        assert octets == wanted, f"{what}: expected {shown(wanted)}, got {shown(octets)}"

    def nothing(self, seconds, what):
        try:
            octets, _ = self.came.get(timeout=seconds)
        except queue.Empty:
            return
        raise AssertionError(f"{what}: got {shown(octets)}")

    def confirm(self, packet, result=0, more=b""):
        """The PKGCNF of a packet that came."""
        octets = escaped(body(confirmation(packet, packet.target, result, more=more), self.mask))
        with self.lock:
            key = packet.target, packet.source, packet.priority
            self.confirmations[key] = octets
            self.write(octets)

    def wait_for_the_end(self):
        assert self.ended.wait(PATIENCE), "the stream stays open"

    def close(self):
        self.socket.close()


def system(subtype, parameters, target, source, crc=False, priority=0, psn=None, confirm=False):
    data = bytes([subtype]) + parameters
    if psn is not None:
        data = b"\0" + data
    full = True
    return Packet(SYS, priority, confirm, crc, full, psn, target, source, data)


def confirmation(packet, by, result=0, more=b""):
    first = tag(1, packet.target.to_bytes(4, "big")) if by != packet.target else b""
    parameters = first + tag(8, bytes([packet.psn])) + tag(9, bytes([result])) + more
    return system(PKGCNF, parameters, packet.source, by, packet.crc, packet.priority)


def hello(given=None, mask=None, role=0, name=b"", period=1000, largest=65536, checks=3, types=0x413E):
    """The tags of INCON and ACCON in ascending order."""
    place = b"" if given is None else tag(1, given.to_bytes(4, "big"))
    place += b"" if mask is None else tag(2, mask.to_bytes(4, "big"))
    pace = b"" if role == 1 else tag(3, struct.pack(">H", period))
    rest = tag(4, struct.pack(">I", largest)) + tag(5, bytes([checks]))
    rest += tag(6, struct.pack(">H", types)) + tag(7, bytes([role]))
    return place + pace + rest + (tag(10, name) if name else b"")
