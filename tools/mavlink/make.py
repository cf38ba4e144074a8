#!/usr/bin/env python3
"""Makes src/dialects/common.rs: the messages of MAVLink's common dialect that the station uses.

    cargo install mavlink-bindgen --version 0.21.0 --features cli
    tools/mavlink/make.py DEFINITIONS

DEFINITIONS is the folder message_definitions/v1.0 of github.com/mavlink/mavlink. The whole dialect
has 250 messages and takes a tenth of a first build. The checksum seeds of all of them are kept, so
that a message that is not used is checked and skipped whole.
"""

import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as tree
from pathlib import Path

HERE = Path(__file__).resolve().parent
HEAD = """\
//! The messages of MAVLink's common dialect that the station uses, and the checksum seeds of all.
//! Made by `tools/mavlink/make.py`; do not edit.

#![allow(missing_docs, deprecated, non_camel_case_types, unused, clippy::all)]

"""
MESSAGES = """
    CAMERA_CAPTURE_STATUS CAMERA_INFORMATION CAMERA_SETTINGS CAMERA_TRACKING_IMAGE_STATUS
    COMMAND_ACK COMMAND_INT COMMAND_LONG GIMBAL_MANAGER_SET_PITCHYAW GIMBAL_MANAGER_STATUS
    HEARTBEAT LANDING_TARGET STORAGE_INFORMATION VIDEO_STREAM_INFORMATION VIDEO_STREAM_STATUS
""".split()


def generate(definitions, name):
    """The code that mavlink-bindgen generates for a dialect in a folder."""
    with tempfile.TemporaryDirectory() as out:
        subprocess.run(["mavlink-bindgen", definitions, out], check=True, stdout=sys.stderr)
        return (Path(out) / f"{name}.rs").read_text()


def trimmed(definitions):
    """The used messages with the enumerations of their fields, without descriptions."""
    messages, enums = [], {}
    for name in ("minimal", "standard", "common"):
        root = tree.parse(definitions / f"{name}.xml").getroot()
        for enum in root.iter("enum"):
            if enum.get("name") in enums:
                enums[enum.get("name")].extend(enum.findall("entry"))
            else:
                enums[enum.get("name")] = enum
        messages.extend(m for m in root.iter("message") if m.get("name") in MESSAGES)
    found = {message.get("name") for message in messages}
    if missing := set(MESSAGES) - found:
        sys.exit(f"no message {', '.join(sorted(missing))}")
    used = {field.get("enum") for message in messages for field in message.iter("field")}

    dialect = tree.Element("mavlink")
    tree.SubElement(dialect, "version").text = "3"
    enums = [enum for name, enum in sorted(enums.items()) if name in used]
    for group, items in (("enums", enums), ("messages", messages)):
        tree.SubElement(dialect, group).extend(items)
    for item in [*enums, *messages]:
        for part in list(item.iter()):
            for child in list(part):
                if child.tag in ("description", "param", "wip"):
                    part.remove(child)
            if part.tag == "field":
                part.text = None
    return tree.tostring(dialect, encoding="unicode")


def closing(code, at):
    """The place after the bracket that matches the one at a place."""
    depth = 0
    for place in range(at, len(code)):
        depth += (code[place] in "([{") - (code[place] in ")]}")
        if depth == 0:
            return place + 1
    raise ValueError("unbalanced brackets")


def without_features(code):
    """Code without the parts that depend on features of the generator's own crate."""
    while match := re.search(r"# \[cfg(_attr)? \((?:any \()?feature", code):
        end = closing(code, match.start() + 2)
        if not match[1]:  # the item that follows goes, too
            while code[end] not in "{;":
                end += 1
            end = closing(code, end) if code[end] == "{" else end
            end = re.compile(r" *;?").match(code, end).end()
        code = code[: match.start()] + code[end:]
    return code


def seeds(code):
    """Number and checksum seed of each message that generated code knows."""
    found = re.findall(
        r"const ID : u32 = (\d+)u32 ; const NAME : & 'static str = \"(\w+)\" ; "
        r"const EXTRA_CRC : u8 = (\d+)u8",
        code,
    )
    return sorted((int(number), int(seed)) for number, _, seed in found)


def main():
    definitions = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        for name in ("minimal", "standard", "common"):
            text = (definitions / f"{name}.xml").read_text()
            (Path(folder) / f"{name}.xml").write_text(text)
        whole = seeds(generate(folder, "common"))
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "common.xml").write_text(trimmed(definitions))
        code = without_features(generate(folder, "common"))

    code = re.sub(r"# ! \[.*?\] ", "", code)  # the module's attributes, which follow
    # A message that is not used has its seed, too.
    begin = code.index("fn extra_crc (id : u32) -> u8 {")
    end = closing(code, code.index("{", begin))
    pairs = ", ".join(f"({number}, {seed})" for number, seed in whole)
    code = (
        code[:begin]
        + "fn extra_crc(id: u32) -> u8 {"
        + "SEEDS.binary_search_by_key(&id, |seed| seed.0).map_or(0, |at| SEEDS[at].1) }"
        + code[end:]
        + f"/// Number and checksum seed of every message of the dialect, by number.\n"
        + f"const SEEDS: [(u32, u8); {len(whole)}] = [{pairs}];"
    )
    # What a macro takes, rustfmt leaves as it is.
    code = re.sub(
        r"bitflags ! \{(.*?)# \[derive.*?pub struct (.*?) \{ (.*?) ; \} \}",
        lambda flags: (
            f"bitflags! {{\n    #[derive(Debug, Copy, Clone, PartialEq)]\n"
            f"    pub struct {flags[2].replace(' :', ':')} {{\n        "
            + flags[3].replace(" ; ", ";\n        ")
            + ";\n    }\n}\n"
        ),
        code,
    )
    file = HERE / "src/dialects/common.rs"
    file.write_text(HEAD + code)
    subprocess.run(["rustfmt", "--edition", "2024", file], check=True)


if __name__ == "__main__":
    main()
