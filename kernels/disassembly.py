#!/usr/bin/env python3
"""Shows that a change leaves the kernels' machine code as it was.

    kernels/disassembly.py dump FILE          builds the crate and writes its kernels' instructions
    kernels/disassembly.py compare OLD NEW    lists the functions that differ, largest first

A kernel is every function that `Isa::run`, `Isa::run_dot`, `Simd::call` or `Dot::call` enters: all
hot loops are inlined into one. Functions are matched by their instructions, not by name, so that a
renamed kernel is the same kernel. Addresses, hashes and symbols of data and calls are left out.
"""

import collections
import difflib
import json
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
ENTRY = re.compile(r"kernels::simd::.*(enter::inner|enter_dot::inner|(Simd|Dot)>::call)::<")
FUNCTION = re.compile(r"^[0-9a-f]+ <(.*)>:$")
INSTRUCTION = re.compile(r"^\s+[0-9a-f]+:\t(.*)$")
RELOCATION = re.compile(r"^\s+[0-9a-f]+: R_\w+\s+(.*)$")


def build():
    """Returns the library, built with symbols that name type parameters."""
    command = ["cargo", "rustc", "--release", "--locked", "-p", "track-cpu-kernels", "--lib"]
    command += ["--message-format=json", "--", "-C", "symbol-mangling-version=v0"]
    output = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    messages = map(json.loads, output.splitlines())
    artifacts = [m for m in messages if m["reason"] == "compiler-artifact"]
    library = next(a for a in artifacts if a["target"]["name"] == "kernels")
    return next(name for name in library["filenames"] if name.endswith(".rlib"))


def normal(instruction):
    """One instruction without addresses: jumps keep their distance from the function's start."""
    text = re.sub(r"\s+(#|//) [0-9a-f]+ <.*$", "", instruction)
    text = re.sub(r"[0-9a-f]+ <.*\+(0x[0-9a-f]+)>$", r"+\1", text)
    text = re.sub(r"[0-9a-f]+ <.*>$", "+0x0", text)
    return re.sub(r"\s+", " ", text)


def functions(library):
    """The instructions of each kernel, by name; those of equal names follow one another."""
    command = ["objdump", "-dr", "--no-show-raw-insn", "-C", library]
    listing = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    found, body = {}, None
    for line in listing.stdout.splitlines():
        if match := FUNCTION.match(line):
            name = re.sub(r"\[[0-9a-f]{8,}\]", "", match[1])
            body = found.setdefault(name, []) if ENTRY.search(name) else None
        elif body is None:
            continue
        elif match := INSTRUCTION.match(line):
            body.append(normal(match[1]))
        elif (match := RELOCATION.match(line)) and body:
            # The symbol of a call or of a constant: its address is what the linker fills in.
            body[-1] = re.sub(r"0x[0-9a-f]+\((%rip)\)|\+0x[0-9a-f]+$", r"symbol\1", body[-1])
    return {name: body for name, body in found.items() if body}


def dump(path):
    found = functions(build())
    with open(path, "w") as file:
        for name, body in sorted(found.items()):
            file.write(f"== {name}\n")
            file.writelines(f"{line}\n" for line in body)
    print(f"{len(found)} kernels, {sum(map(len, found.values()))} instructions")


def load(path):
    found = {}
    for line in open(path):
        if line.startswith("== "):
            body = found.setdefault(line[3:].strip(), [])
        else:
            body.append(line.rstrip("\n"))
    return found


def compare(old_path, new_path):
    """Prints what differs and returns 1, or 0 if nothing does."""
    old, new = load(old_path), load(new_path)
    bodies = collections.defaultdict(list)
    for name, body in old.items():
        bodies["\n".join(body)].append(name)
    rest = {}
    for name, body in new.items():
        same = bodies["\n".join(body)]
        if same:
            same.remove(name if name in same else same[0])
        else:
            rest[name] = body
    gone = {name: old[name] for names in bodies.values() for name in names}
    print(f"{len(old)} kernels before, {len(new)} after, {len(new) - len(rest)} the same")
    for name, body in by_size(rest):
        print(f"\nnew  {len(body):6} instructions  {name}")
        if not gone:
            continue
        near = max(gone, key=lambda n: (shared(n, name), -abs(len(gone[n]) - len(body))))
        before = gone.pop(near)
        print(f"like {len(before):6} instructions  {near}")
        if len(body) < 4000:
            ratio = difflib.SequenceMatcher(None, before, body, autojunk=False).ratio()
            print(f"     {100 * ratio:6.1f} % the same")
    for name, body in by_size(gone):
        print(f"\ngone {len(body):6} instructions  {name}")
    return 1 if rest or gone else 0


def by_size(functions):
    return sorted(functions.items(), key=lambda item: -len(item[1]))


def shared(a, b):
    """How many words two names have in common."""
    return len(set(re.findall(r"\w+", a)) & set(re.findall(r"\w+", b)))


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["dump", path]:
            dump(path)
        case ["compare", old_path, new_path]:
            sys.exit(compare(old_path, new_path))
        case _:
            sys.exit(__doc__)
