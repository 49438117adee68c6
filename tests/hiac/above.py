"""An employer above `fipad --hiac`, and a device below it: above.py HOST:PORT HOST:PORT

The daemon is 20:C4:D2:00 and employs under 00:00:00:FF; at the first place it is an employee, and
the second is for its devices. The employer above has the mask 00:00:3F:00.
"""

import sys

from wire import *

HIGH, LOW = 0x3F00, 0xFF
TOP, E = address("20:C4:C0:00"), address("20:C4:D2:00")


def say(link, given, to=None, subtype=INCON):
    link.send(system(subtype, hello(given, HIGH, 0), given if to is None else to, TOP))
    link.expect(system(ACCON, hello(given, HIGH, 2), TOP, given), "ACCON of the daemon")
    link.alive = True


def below(place):
    link = Link(place, LOW, E)
    link.expect(system(INCON, hello(E + 1, LOW, 0), E + 1, E), "INCON to the device")
    link.send(system(ACCON, hello(E + 1, LOW, 2, checks=1), E, E + 1))
    link.alive = True
    return link


def gateway(top, device):
    """One way down, the check and the addresses adapted, and nothing up."""
    data = message(COMMAND, b"from far above")
    command = Packet(MSG, 4, False, True, True, None, E + 1, TOP, data)
    top.send(command)
    device.expect(command._replace(crc=False), "a command to a subemployee")
    colleague = TOP + 0x100
    for packet, result in (
        (Packet(MSG, 4, True, True, True, 0, E + 1, TOP, b"\0" + data), 4),
        (Packet(MSG, 4, True, True, True, 0, E + 1, colleague, b"\0" + data), 4),
        (Packet(MSG, 4, True, True, True, 1, E + 9, TOP, b"\0" + data), 4),
        (Packet(MSG, 4, True, True, True, 2, E, TOP, b"\0" + message(9, b"")), 7),
    ):
        top.send(packet)
        answer = top.next("PKGCNF")
        _, tags = tags_of(answer.data)
        assert (tags[8][0], tags[9][0], answer.source) == (packet.psn, result, E), (packet, answer)
        answering = None if packet.target == E else packet.target.to_bytes(4, "big")
        assert tags.get(1) == answering, answer
    missing = command._replace(target=E + 9)
    top.send(missing)
    top.nothing(0.3, "an answer to what goes nowhere and is not to be confirmed")
    up = Packet(MSG, 4, True, False, True, 0, TOP, E + 1, b"\0" + message(INFORMATION, b"up"))
    device.send(up)
    answer = device.next("PKGCNF")
    _, tags = tags_of(answer.data)
    assert (tags[9][0], tags[1]) == (b"\4"[0], TOP.to_bytes(4, "big")), answer
    top.nothing(0.3, "something that went up")


def obeys(top):
    """The daemon itself is commanded from above, and moves with its workgroup."""
    command = Packet(MSG, 4, True, True, False, 0, E, TOP, b"\0" + message(COMMAND, b"report"))
    top.send(command)
    top.expect(confirmation(command, E), "the confirmation of the daemon")


def moved(top, device):
    new = address("20:C4:D3:00")
    say(top, new, to=E, subtype=RECON)
    recon = device.next("RECON")
    data = bytes([RECON]) + hello(new + 1, LOW, 0)
    wanted = (SYS, E + 1, E, data)
    assert (recon.type, recon.target, recon.source, recon.data) == wanted, recon
    device.send(system(ACCON, hello(new + 1, LOW, 2, checks=1), new, new + 1))
    data = message(COMMAND, b"there")
    command = Packet(MSG, 4, False, True, True, None, new + 1, TOP, data)
    top.send(command)
    device.expect(command._replace(crc=False), "a command to the device that moved along")


def main(above, devices):
    top = Link(above, HIGH, TOP)
    top.nothing(1.2, "an employee speaks before its employer")
    say(top, E)
    device = below(devices)
    gateway(top, device)
    obeys(top)
    moved(top, device)


if __name__ == "__main__":
    main(*sys.argv[1:])
