"""Plays a robot with the C++ fipa_services, as far as its directory goes.

Arguments: the addresses of the interfaces to speak on. Commands on standard input, a line each:
`publish LABEL KEY=VALUE|KEY=VALUE…`, `withdraw LABEL`. Each is answered with `done`.
"""
import sys

from zeroconf import ServiceInfo, Zeroconf

TYPE = "_fipa_service_directory._udp.local."

zeroconf = Zeroconf(interfaces=sys.argv[1:])
services = {}
for line in sys.stdin:
    command, label, *rest = line.rstrip("\n").split(" ", 2)
    if command == "publish":
        strings = [string.encode() for string in rest[0].split("|")]
        text = b"".join(bytes([len(string)]) + string for string in strings)
        service = ServiceInfo(
            TYPE, f"{label}.{TYPE}", port=0, properties=text,
            server="cpp-robot.local.", parsed_addresses=sys.argv[1:],
        )
        zeroconf.register_service(service, strict=False)
        services[label] = service
    else:
        zeroconf.unregister_service(services.pop(label))
    print("done", flush=True)
zeroconf.close()
