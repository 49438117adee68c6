"""The text format written a second time, against `fipa text encode | decode`: text.py FIPA SEED"""

import json
import random
import subprocess
import sys

FIELDS = {"O": "origin", "D": "destination", "X": "reference", "U": "urgency",
          "A": "action", "Q": "question", "R": "answer", "S": "status"}
BLANKS = b" \t\r\n"
LONGEST = 1024


def tool(fipa, command, octets):
    words = [fipa, "text", command]
    ended = subprocess.run(words, input=octets, capture_output=True, timeout=60)
    return ended.stdout, ended.returncode


def cut(octets):
    """Messages with their braces, and what was not finished or is too long."""
    current = None
    for octet in octets:
        if current is None:
            current = bytearray(b"{") if octet == ord("{") else None
        elif octet == ord("{"):
            if len(current) <= LONGEST:
                yield bytes(current), "unfinished"
            current = bytearray(b"{")
        else:
            current.append(octet)
            if len(current) == LONGEST + 1:
                yield bytes(current[:LONGEST]), "length"
            if octet == ord("}"):
                if len(current) <= LONGEST:
                    yield bytes(current), None
                current = None
    if current is not None and len(current) <= LONGEST:
        yield bytes(current), "unfinished"


def read(octets):
    """The JSON of a message, or the word of its fault."""
    inner = octets[1:-1]
    if any(octet not in BLANKS and not 0x20 <= octet <= 0x7E for octet in inner):
        return "character"
    parts = inner.split(b";")
    if len(parts) > 1 and not parts[-1].strip(BLANKS):
        parts.pop()
    found, faults = {}, set()
    for part in parts:
        ends = [at for at in (part.find(b":"), part.find(b"=")) if at >= 0]
        if not ends:
            faults.add("character" if set(part.strip(BLANKS)) & set(b"\t\r\n") else "syntax")
            continue
        key, value = part[:min(ends)].strip(BLANKS), part[min(ends) + 1:].strip(BLANKS)
        if set(key + value) & set(b"\t\r\n"):
            faults.add("character")
        if not key or b" " in key:
            faults.add("syntax")
        if key in found:
            faults.add("duplicate")
        found[key] = value
    return judged({key.decode(): value.decode() for key, value in found.items()}, faults)


def judged(found, faults):
    kinds = [key for key in "AQRS" if key in found]
    required = {"A": "", "Q": "OD", "R": "OD", "S": "O"}.get("".join(kinds), "")
    if len(kinds) != 1:
        faults.add("kind")
    if "A" in kinds and "D" not in found:
        faults.add("missing")
    if any(key not in found for key in required):
        faults.add("missing")
    if any(found.get(key) == "" for key in "ODX"):
        faults.add("missing")
    if "S" in kinds and "D" in found:
        faults.add("unexpected")
    urgency = found.get("U")
    if urgency is not None and (len(urgency) != 1 or not urgency.isdigit()):
        faults.add("urgency")
    for word in ("character", "syntax", "duplicate", "kind", "missing", "unexpected", "urgency"):
        if word in faults:
            return word
    known = {FIELDS[key]: found[key] for key in FIELDS if key in found}
    if urgency is not None:
        known["urgency"] = int(urgency)
    other = {key: found[key] for key in found if key not in FIELDS}
    return known | ({"other": other} if other else {})


def written(message):
    fields = [(key, str(message[name])) for key, name in FIELDS.items() if name in message]
    fields += sorted(message.get("other", {}).items())
    shown = (f"{key}{'=' if key in 'XU' else ':'}{value}" for key, value in fields)
    return ("{" + ";".join(shown) + "}").encode()


def random_message(chance):
    def value(least):
        length = chance.randrange(least, 12)
        letters = "".join(chr(chance.choice([*range(0x20, 0x7F)])) for _ in range(length))
        text = "".join(letter for letter in letters if letter not in "{};").strip()
        return text or "x" * least

    kind = chance.choice(["action", "question", "answer", "status"])
    message = {}
    if kind != "action" or chance.random() < 0.5:
        message["origin"] = value(1)
    if kind != "status":
        message["destination"] = value(1)
    if chance.random() < 0.5:
        message["reference"] = value(1)
    if chance.random() < 0.5:
        message["urgency"] = chance.randrange(10)
    message[kind] = value(0)
    if chance.random() < 0.3:
        message["other"] = {key: value(0) for key in chance.sample(["Z", "b", "o", "#1"], 2)}
    return message


def decode(fipa, octets):
    shown, code = tool(fipa, "decode", octets)
    lines = [json.loads(line) for line in shown.splitlines()]
    wanted, words = [], set()
    for message, fault in cut(octets):
        said = fault or read(message)
        if isinstance(said, str):
            words.add(said)
            said = {"error": said, "octets": message.hex()}
        wanted.append(said)
    for line, want in zip(lines, wanted):
        assert line == want, f"{line}\n{want}"
    assert len(lines) == len(wanted), (len(lines), len(wanted))
    assert code == any("error" in line for line in wanted), code
    return words


def damaged(chance, octets):
    out = bytearray()
    for octet in octets:
        dice = chance.random()
        if dice < 0.01:
            out += bytes([chance.choice(b"{};:=ODXUAQRS \t\x01\xC3"), octet])
        elif dice > 0.02:
            out.append(octet)
    return bytes(out)


def main(fipa, seed):
    chance = random.Random(int(seed))
    messages = [random_message(chance) for _ in range(400)]
    lines = "".join(json.dumps(message) + "\n" for message in messages)
    octets, code = tool(fipa, "encode", lines.encode())
    wanted = b"".join(written(message) for message in messages)
    assert (octets, code) == (wanted, 0), (octets[:200], wanted[:200], code)
    assert decode(fipa, octets) == set()
    seen = decode(fipa, damaged(chance, octets))
    seen |= decode(fipa, bytes(chance.choice(b"{{{}};:=ODXUAQRS 1") for _ in range(50_000)))
    seen |= decode(fipa, b"{D:B;A:" + b"x" * 1020 + b"}{O:A;D:B;S:x}{D:B;A:x;D:C}" + octets)
    words = {"unfinished", "length", "character", "syntax", "duplicate", "kind", "missing"}
    assert seen == words | {"unexpected", "urgency"}, seen


if __name__ == "__main__":
    main(*sys.argv[1:])
