"""Devices for `fipad --hiac`: device.py HOST:PORT FIPA CONTROL

The daemon is robot1 at 20:C4:D2:00 under 00:00:00:FF and knows 20:C4:D2:20 as echo@robot1.
"""

import json
import subprocess
import sys
import time

from wire import *

MASK, E = 0xFF, address("20:C4:D2:00")
ALIAS = E + 0x20
DEFAULT = 4


class Fleet:
    """What others of the fleet say to a device."""

    def __init__(self, tool, control):
        self.tool, self.control, self.conversations = tool, control, 0

    def run(self, *words):
        command = [self.tool, *words, "--control", self.control]
        return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE).stdout

    def say(self, performative, content, to="probe@robot1"):
        self.conversations += 1
        return Said(subprocess.Popen(
            [self.tool, "send", "--to", to, "--from", f"m{self.conversations}@robot1",
             "--performative", performative, "--content", content, "--wait", "10", "--json",
             "--conversation-id", f"c-{self.conversations}", "--control", self.control],
            stdout=subprocess.PIPE, text=True))

    def wait_for(self, devices):
        until = time.monotonic() + PATIENCE
        while True:
            found = self.run("hiac", "devices", "--json").splitlines()
            found = {json.loads(line)["name"]: json.loads(line)["address"] for line in found}
            if found == devices:
                return
            assert time.monotonic() < until, f"expected {devices}, found {found}"
            time.sleep(0.1)


class Said:
    """A message that was sent, and its answers."""

    def __init__(self, process):
        self.process = process

    def hears(self, performative, content):
        for line in self.process.stdout:
            reply = json.loads(line).get("message")
            if reply is not None:
                said = reply["performative"], reply.get("content", "")
                assert said == (performative, content), f"{said}, expected {performative} {content}"
                return
        raise AssertionError(f"no answer in place of {performative} {content}")

    def ends(self):
        self.process.kill()
        self.process.wait()


class Device:
    """A level of the workgroup with a stream of its own."""

    def __init__(self, place, level, name, **abilities):
        self.level, self.address, self.name = level, E + level, name
        self.crc = abilities.get("checks", 3) & 2 != 0
        self.link = Link(place, MASK, E)
        self.accon = system(ACCON, hello(E + level, MASK, 2, name, **abilities), E, E + level)
        self.own = {}

    def incon(self):
        return system(INCON, hello(self.address, MASK, 0), self.address, E)

    def connect(self):
        self.link.expect(self.incon(), "INCON")
        self.link.send(self.accon)
        self.link.alive = True

    def hears(self, data, kind=MSG, priority=DEFAULT, more=0):
        """A numbered packet with these data comes, to be confirmed."""
        psn = self.own[priority] = (self.own.get(priority, -1) + 1) % 256
        octets = bytes([more]) + data
        packet = Packet(kind, priority, True, self.crc, False, psn, self.address, E, octets)
        self.link.expect(packet, f"{kind} {data}")
        return packet

    def tells(self, data, kind=MSG, to=E, priority=DEFAULT):
        psn = self.link.number(to, priority)
        octets = b"\0" + data
        packet = Packet(kind, priority, True, self.crc, False, psn, to, self.address, octets)
        self.link.send(packet)
        return packet

    def refused(self, packet, result, by=E, more=None):
        answer = self.link.next("PKGCNF")
        subtype, tags = tags_of(answer.data)
        said = subtype, tags[8][0], tags[9][0], answer.source, answer.target
        assert said == (PKGCNF, packet.psn, result, by, self.address), answer
        answering = tags.get(1)
        assert answering == (None if by == packet.target else packet.target.to_bytes(4, "big"))
        assert more is None or tags.get(4) == more, answer


def connection(place, fleet):
    """INCON until there is an answer that repeats it."""
    refusing = Device(place, 1, b"probe")
    refusing.link.expect(refusing.incon(), "INCON")
    refusing.link.send(system(REFCON, tag(9, b"\1"), E, refusing.address))
    refusing.link.nothing(2.2, "an INCON after REFCON")
    refusing.link.close()
    device = Device(place, 1, b"probe")
    for _ in range(2):
        device.link.expect(device.incon(), "INCON")
    other = system(ACCON, hello(E + 9, MASK, 2), E, device.address)
    device.link.write(b"\r\nboot\xFC\xF9")
    device.link.send(other)
    device.connect()
    fleet.wait_for({"probe@robot1": "20:C4:D2:01"})
    return device


def asked(device, fleet):
    """Requests, queries, information, subscriptions, cancel."""
    request = fleet.say("request", "forward 10")
    command = device.hears(message(COMMAND, b"forward 10"))
    request.hears("agree", "")
    until = time.monotonic() + PATIENCE
    while device.link.repeated < 2:
        assert time.monotonic() < until, "it is not sent again"
        time.sleep(0.05)
    device.link.confirm(command)
    request.hears("inform", "done")

    query = fleet.say("query-ref", "where")
    psn = device.own[DEFAULT] = device.own[DEFAULT] + 1
    question = device.link.next("a question")
    reference = question.data[2]
    assert reference != 0
    data = b"\0" + message(QUESTION, b"where", reference)
    head = Packet(MSG, DEFAULT, True, device.crc, False, psn, device.address, E, data)
    assert question == head, question
    device.link.confirm(question)
    answer = device.tells(message(ANSWER, b"3 4", reference))
    device.link.expect(confirmation(answer, E), "PKGCNF of the answer")
    query.hears("inform", "3 4")

    inform = fleet.say("inform", "it rains")
    device.link.confirm(device.hears(message(INFORMATION, b"it rains")))
    inform.ends()

    for result in (1, 5, 7):
        request = fleet.say("request", "no")
        device.link.confirm(device.hears(message(COMMAND, b"no")), result)
        request.hears("agree", "")
        for line in request.process.stdout:
            assert json.loads(line)["message"]["performative"] == "failure", line
            break
        request.ends()

    subscription = fleet.say("subscribe", "all")
    subscription.hears("agree", "")
    device.link.send(Packet(SIG, 1, False, False, False, None, E, device.address, b"\x03\x0A\xFF"))
    subscription.hears("inform", "3 0aff")
    device.link.send(Packet(MSG, 4, False, True, True, None, E, device.address, b"\4\0hot"))
    subscription.hears("inform", "hot")
    subscription.ends()


def fragments(device, fleet):
    """The largest packet of the device is 64 octets."""
    text = "".join(chr(33 + at % 90) for at in range(100))
    request = fleet.say("request", text)
    data = message(COMMAND, text.encode())
    room = 64 - 2 - 1 - 2 - 1 - (4 if device.crc else 1) - 1
    parts = [data[at:at + room] for at in range(0, len(data), room)]
    for index, part in enumerate(parts):
        more = 0x80 if index + 1 < len(parts) else 0
        device.link.confirm(device.hears(part, more=more | index))
    request.hears("agree", "")
    request.hears("inform", "done")


def asks(device):
    """The fleet answers under an alias; what is nobody is not there."""
    question = device.tells(message(QUESTION, b"are you there", 5), to=ALIAS)
    device.link.expect(confirmation(question, ALIAS), "PKGCNF of the alias")
    # Before its first packet that is to be confirmed, as between all colleagues.
    incon = system(INCON, hello(role=1), device.address, ALIAS)
    device.link.expect(incon, "the INCON of a colleague")
    device.link.send(system(ACCON, hello(role=1), ALIAS, device.address))
    answer = device.link.next("the answer of the fleet")
    assert answer.source == ALIAS and answer.confirm, answer
    assert answer.data == b"\0" + message(ANSWER, b"are you there", 5), answer
    device.link.confirm(answer)
    device.refused(device.tells(message(COMMAND, b"go"), to=ALIAS), 4, by=ALIAS)
    device.refused(device.tells(message(COMMAND, b"go")), 4)
    device.refused(device.tells(message(INFORMATION, b"hi"), to=E + 9), 5)
    device.refused(device.tells(b"\0\0\1\2", SYNC), 4)
    device.refused(device.tells(b"\0\0\0", SMPH), 5)
    device.refused(device.tells(b"\0", 9), 6)


def colleagues(place, fleet, first):
    """The second device has CRC-32 and large packets, the first has neither."""
    second = Device(place, 2, b"probe")
    second.connect()
    fleet.wait_for({"probe@robot1": "20:C4:D2:01", "probe-2@robot1": "20:C4:D2:02"})
    to_first = (first.address, second.address)
    warning = Packet(MSG, 3, False, True, False, None, *to_first, message(WARNING, b"ice"))
    second.link.send(warning)
    first.link.expect(warning._replace(crc=False), "the warning with the other check")
    numbered = Packet(MSG, 3, True, True, False, 0, *to_first, b"\0" + message(WARNING, b"ice"))
    second.link.send(numbered)
    first.link.expect(numbered._replace(crc=False), "the numbered warning")
    first.link.send(confirmation(numbered._replace(crc=False), first.address))
    back = confirmation(numbered._replace(crc=False), first.address)
    second.link.expect(back, "the confirmation through the employer")
    long = message(INFORMATION, b"x" * 60)
    packet = second.tells(long, to=first.address)
    second.refused(packet, 8, more=(64).to_bytes(4, "big"))
    above = Packet(MSG, 4, False, True, True, None, E + 0x100, second.address, b"\0\0hi")
    second.link.send(above)
    own = Packet(SIG, 1, False, False, False, None, E + 0xFF, second.address, b"\x07")
    second.link.send(own)
    first.link.expect(own, "the broadcast")
    second.link.nothing(0.3, "its own broadcast")
    return second


def end(fleet, first, second):
    """Silence is the end, and the workgroup hears of it."""
    query = fleet.say("query-ref", "where")
    assert first.link.next("a question").type == MSG
    first.link.alive = False
    first.link.wait_for_the_end()
    query.hears("failure", "the connection was lost")
    lost = bytes([0]) + first.address.to_bytes(4, "big")
    told = second.link.next("the signal that a station is lost")
    assert (told.type, told.data, told.target, told.priority) == (SIG, lost, E + 0xFF, 1), told
    fleet.wait_for({"probe-2@robot1": "20:C4:D2:02"})
    before = second.link.signs
    time.sleep(2)
    assert second.link.signs - before >= 3, "too few signs of life"
    second.link.close()
    fleet.wait_for({})


def main(place, tool, control):
    fleet = Fleet(tool, control)
    device = connection(place, fleet)
    asked(device, fleet)
    asks(device)
    device.link.close()
    fleet.wait_for({})
    small = Device(place, 1, b"probe", checks=1, largest=64)
    small.connect()
    fleet.wait_for({"probe@robot1": "20:C4:D2:01"})
    fragments(small, fleet)
    end(fleet, small, colleagues(place, fleet, small))


if __name__ == "__main__":
    main(*sys.argv[1:])
