"""An employer for `fipa hiac device`: employer.py HOST:PORT"""

import sys
import time

from wire import *

MASK = 0xFF
E, X, Y = address("20:C4:D2:00"), address("20:C4:D3:00"), address("20:C4:D4:00")
DRIVE, LAMP = E + 5, E + 7


def stream(place, base):
    return Link(place, MASK, base)


def incon(source, given, **tags):
    return system(INCON, hello(given, MASK, 0, **tags), given, source)


def accon(target, given):
    return system(ACCON, hello(given, MASK, 2, b"drive"), target, given)


def refused(link, packet, result, what):
    link.send(packet)
    answer = link.next(what)
    subtype, tags = tags_of(answer.data)
    said = (answer.type, subtype, answer.target, answer.source, tags[9][0])
    assert said == (SYS, REFCON, packet.source, packet.target, result), f"{what}: {answer}"


def result_of(link, packet, what):
    answer = link.next(what)
    subtype, tags = tags_of(answer.data)
    assert (answer.type, subtype, tags[8][0]) == (SYS, PKGCNF, packet.psn), f"{what}: {answer}"
    assert (answer.full, answer.psn, answer.crc, answer.priority) == (
        True, None, packet.crc, packet.priority), f"{what}: {answer}"
    return tags[9][0]


def connect(place):
    link = stream(place, E)
    link.nothing(1.2, "an employee speaks before its employer")
    assert link.signs == 0, "an employee gave a sign of life before its employer"
    no_mask = hello(DRIVE, None)
    refused(link, system(INCON, no_mask, DRIVE, E), 7, "an INCON without mask")
    refused(link, incon(E, DRIVE, checks=0), 6, "no check in common")
    refused(link, incon(E, DRIVE, period=10), 6, "a period below 20")
    refused(link, incon(E + 1, DRIVE), 7, "an employer that is not level 0")
    refused(link, incon(E, DRIVE + 0x100), 7, "an address of another subnetwork")
    for _ in range(2):
        link.send(incon(E, DRIVE, largest=128))
        link.expect(accon(E, DRIVE), "ACCON")
    link.alive = True
    return link


def ask(link, data, kind=MSG, source=E, priority=4, crc=True, full=False):
    """Something with a confirmation; what was sent."""
    psn = link.number((source, DRIVE), priority)
    packet = Packet(kind, priority, True, crc, full, psn, DRIVE, source, b"\0" + data)
    link.send(packet)
    return packet


def accepted(link, packet, what):
    link.expect(confirmation(packet, packet.target), what)


def answered(link, packet, data, own, kind=None, to=None):
    """The reply of the device, with a number of its own."""
    to = packet.source if to is None else to
    psn = own.number((DRIVE, to), packet.priority)
    kind = packet.type if kind is None else kind
    reply = Packet(kind, packet.priority, True, True, packet.full, psn, to, DRIVE, b"\0" + data)
    link.expect(reply, "the reply")
    link.confirm(reply)


class Numbers:
    """The numbers that the other side should use."""

    def __init__(self):
        self.numbers = {}

    number = Link.number


def questions(link, own):
    for priority in range(8):
        for crc in (False, True):
            for full in (False, True):
                text = bytes([0xF8, 0xFC, priority, crc, full])
                packet = ask(link, message(QUESTION, text, 9), MSG, E, priority, crc, full)
                accepted(link, packet, "the confirmation of a question")
                answered(link, packet, message(ANSWER, text, 9), own)
    plain = Packet(MSG, 4, False, False, True, None, DRIVE, E, message(QUESTION, b"hi", 3))
    link.send(plain)
    reply = Packet(MSG, 4, False, True, True, None, E, DRIVE, message(ANSWER, b"hi", 3))
    link.expect(reply, "the answer that nobody confirms")
    packet = ask(link, message(COMMAND, b"go", 8))
    accepted(link, packet, "a command with a reference")
    answered(link, packet, message(ANSWER, b"go", 8), own)
    packet = ask(link, message(COMMAND, b"go"))
    accepted(link, packet, "a command without")
    link.send(packet)
    accepted(link, packet, "a repetition")
    link.nothing(0.3, "the answer to a command without reference")


def fragments(link, own):
    text = bytes(range(256)) + b"end"
    data = message(QUESTION, text, 7)
    parts = [data[at:at + 100] for at in range(0, len(data), 100)]
    for index, part in enumerate(parts):
        more = 0x80 if index + 1 < len(parts) else 0
        psn = link.number((E, DRIVE), 4)
        packet = Packet(MSG, 4, True, True, False, psn, DRIVE, E, bytes([more | index]) + part)
        link.send(packet)
        accepted(link, packet, f"fragment {index}")
    # 128 octets less type, flags, number, two levels, length and check.
    room = 128 - 2 - 1 - 2 - 1 - 4 - 1
    data = message(ANSWER, text, 7)
    parts = [data[at:at + room] for at in range(0, len(data), room)]
    for index, part in enumerate(parts):
        more = 0x80 if index + 1 < len(parts) else 0
        psn = own.number((DRIVE, E), 4)
        reply = Packet(MSG, 4, True, True, False, psn, E, DRIVE, bytes([more | index]) + part)
        link.expect(reply, f"fragment {index} of the answer")
        link.confirm(reply)
    stray = Packet(MSG, 4, True, True, False, link.number((E, DRIVE), 4), DRIVE, E, b"\x05lost")
    link.send(stray)
    assert result_of(link, stray, "a fragment that continues nothing") == 3


def what_is_wrong(link):
    packet = Packet(MSG, 4, True, True, False, 77, DRIVE, E, b"\0" + message(QUESTION, b"x", 1))
    octets = bytearray(body(packet, MASK))
    octets[-1] ^= 1
    link.write(escaped(octets))
    link.write(b"noise\xF9" + bytes([START, EXCH]) + b"\x11")
    link.nothing(0.3, "an answer to what cannot be read")
    packet = ask(link, b"\0", 9)
    assert result_of(link, packet, "an unknown type") == 6
    packet = ask(link, message(9, b"x"))
    assert result_of(link, packet, "an unknown kind of message") == 7
    packet = ask(link, message(COMMAND, b"go"), source=LAMP)
    assert result_of(link, packet, "a command of a colleague") == 4
    above = Packet(MSG, 4, False, True, True, None, DRIVE, X, message(COMMAND, b"from above"))
    link.send(above)
    link.nothing(0.3, "an answer to a command from far above")
    above = Packet(MSG, 4, True, True, True, 0, DRIVE, X, b"\0" + message(QUESTION, b"x", 1))
    link.send(above)
    assert result_of(link, above, "a question from far above") == 4


def semaphores(link, own):
    def operate(operation, number, reply=None, result=0):
        packet = ask(link, bytes([operation]) + number.to_bytes(2, "big"), SMPH)
        assert result_of(link, packet, f"semaphore {number}, {operation}") == result
        if reply is not None:
            answered(link, packet, bytes([reply]) + number.to_bytes(2, "big"), own)

    operate(2, 0, reply=0x82)
    operate(0, 0, reply=0x80)
    operate(0, 0, reply=0x80)
    operate(2, 0, reply=0x83)
    operate(1, 0)
    operate(2, 0, reply=0x82)
    operate(1, 0, result=1)
    operate(0, 8, result=5)


def memory(link, own):
    at = (16).to_bytes(4, "big")
    packet = ask(link, at + b"abc", SHMW)
    accepted(link, packet, "writing")
    packet = ask(link, at + b"\0\3", SHMR)
    accepted(link, packet, "reading")
    answered(link, packet, at + b"abc", own, SHMW)
    for data, kind, source, result in (
        ((250).to_bytes(4, "big") + b"\0\x0A", SHMR, E, 5),
        ((250).to_bytes(4, "big") + b"0123456789", SHMW, E, 5),
        (at + b"xyz", SHMW, LAMP, 4),
        (at + b"\0", SHMR, E, 7),
    ):
        packet = ask(link, data, kind, source)
        assert result_of(link, packet, f"memory: {data}") == result, data


def colleague(link):
    """The lamp's side of INCON, which goes through the employer."""
    link.send(system(INCON, hello(role=1), DRIVE, LAMP))
    link.expect(system(ACCON, hello(role=1, name=b"drive"), LAMP, DRIVE), "ACCON to a colleague")
    link.numbers.pop(((LAMP, DRIVE), 4), None)


def barrier(link, own):
    def say(operation, count, source=E, result=0):
        packet = ask(link, bytes([operation, 0, 6, count]), SYNC, source)
        assert result_of(link, packet, f"barrier: {operation}, {count}") == result
        return packet

    say(0, 0, result=5)
    say(0, 2)
    say(0, 2)
    say(0, 3, LAMP, result=1)
    say(2, 0)
    say(0, 2)
    last = say(0, 2, LAMP)
    released = {}
    for _ in range(2):
        reply = link.next("release")
        assert (reply.type, reply.data, reply.confirm) == (SYNC, b"\0\x01\0\x06\x02", True), reply
        released[reply.target] = reply
        own.number((DRIVE, reply.target), reply.priority)
        link.confirm(reply)
    assert set(released) == {E, last.source}, released


def moves(place, link):
    """RECON, a transfer, and who may employ it when."""
    other = stream(place, X)
    refused(other, incon(X, X + 5), 1, "an INCON while it has an employer")
    other.close()
    old, new = DRIVE, E + 9
    link.send(system(RECON, hello(new, MASK, 0), old, E))
    link.expect(accon(E, new), "ACCON from the new address")
    transfer = tag(1, new.to_bytes(4, "big")) + tag(13, X.to_bytes(4, "big"))
    packet = Packet(SYS, 0, True, True, False, 0, new, E, b"\0" + bytes([EMPTRF]) + transfer)
    link.send(packet)
    link.expect(confirmation(packet, new), "the transfer")
    link.close()
    third = stream(place, Y)
    refused(third, incon(Y, Y + 5), 1, "an INCON of a third while it passes over")
    third.close()
    new_employer = stream(place, X)
    new_employer.send(incon(X, X + 9))
    new_employer.expect(accon(X, X + 9), "ACCON to the new employer")
    new_employer.alive = True
    return new_employer


def last(place, link):
    """It gives signs of life, and silence is the end; a takeover follows."""
    before = link.signs
    time.sleep(2)
    assert link.signs - before >= 3, "too few signs of life"
    link.alive = False
    link.wait_for_the_end()
    taker = stream(place, Y)
    taker.send(incon(Y, Y + 3))
    taker.expect(accon(Y, Y + 3), "ACCON to who takes it over")
    taker.send(system(REFCON, tag(9, b"\1"), Y + 3, Y))
    taker.nothing(0.3, "an answer to REFCON")
    again = stream(place, E)
    again.send(incon(E, DRIVE))
    again.expect(accon(E, DRIVE), "ACCON of a device that was removed")


def main(place):
    link, own = connect(place), Numbers()
    questions(link, own)
    fragments(link, own)
    what_is_wrong(link)
    semaphores(link, own)
    memory(link, own)
    colleague(link)
    barrier(link, own)
    last(place, moves(place, link))


if __name__ == "__main__":
    main(*sys.argv[1:])
