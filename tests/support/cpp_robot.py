"""Plays a robot with the C++ fipa_services: its directory, and letters of one connection each.

Arguments: the address to speak at. What it sees is told on standard output, JSON a line:
{"listens": PORT}, {"found": LABEL, "strings": [...]}, {"gone": LABEL}, {"letter": HEX}, {"done": …}.
Commands on standard input: `publish LABEL KEY=VALUE|KEY=VALUE…`, `withdraw LABEL`,
`send HOST PORT HEX`.
"""
import json
import socket
import sys
import threading
import time

from zeroconf import ServiceBrowser, ServiceInfo, ServiceListener, Zeroconf

TYPE = "_fipa_service_directory._udp.local."
address = sys.argv[1]
lock = threading.Lock()


def tell(**what):
    with lock:
        print(json.dumps(what), flush=True)


def label_of(name):
    return name.removesuffix("." + TYPE)


def strings_of(text):
    strings = []
    while text:
        strings.append(text[1 : 1 + text[0]].decode())
        text = text[1 + text[0] :]
    return strings


class Directory(ServiceListener):
    def add_service(self, zeroconf, kind, name):
        info = zeroconf.get_service_info(kind, name, timeout=5000)
        if info is not None:
            tell(found=label_of(name), strings=strings_of(info.text))

    update_service = add_service

    def remove_service(self, zeroconf, kind, name):
        tell(gone=label_of(name))


def listen(listener):
    """One letter a connection, read to the end of the stream."""
    while True:
        connection, _ = listener.accept()
        octets = b""
        while part := connection.recv(4096):
            octets += part
        connection.close()
        if octets:
            tell(letter=octets.hex())


listener = socket.create_server((address, 0))
tell(listens=listener.getsockname()[1])
threading.Thread(target=listen, args=[listener], daemon=True).start()
zeroconf = Zeroconf(interfaces=[address])
browser = ServiceBrowser(zeroconf, TYPE, Directory())
services = {}
for line in sys.stdin:
    command, argument, *rest = line.rstrip("\n").split(" ", 2)
    if command == "publish":
        strings = [string.encode() for string in rest[0].split("|")]
        text = b"".join(bytes([len(string)]) + string for string in strings)
        service = ServiceInfo(
            TYPE, f"{argument}.{TYPE}", port=0, properties=text,
            server="cpp-robot.local.", parsed_addresses=[address],
        )
        zeroconf.register_service(service, strict=False)
        services[argument] = service
    elif command == "withdraw":
        zeroconf.unregister_service(services.pop(argument))
    else:
        port, octets = rest[0].split(" ")
        octets = bytes.fromhex(octets)
        connection = socket.create_connection((argument, int(port)))
        for at in range(0, len(octets), 100):
            connection.sendall(octets[at : at + 100])
            time.sleep(0.005)
        connection.close()
    tell(done=command)
zeroconf.close()
