"""Reads and writes weights files of track-cpu, as FORMAT.md describes; needs NumPy only.

    python track_cpu_weights.py SOURCE COPY
"""

import json
import struct
import sys

import numpy as np

DTYPES = {"F32": np.dtype("<f4"), "F16": np.dtype("<f2")}


def shapes(a):
    """Name -> shape of every tensor that the architecture `a` implies."""
    w, b, e = a["widths"], a["widths"]["backbone"], a["encoder"]
    assert not e or (e["layers"], e["shared"], e["position"]) == (1, True, "before_neck"), e
    convs = [("backbone.conv1", 11, 3, b[0]), ("backbone.conv2", 5, b[0], b[1])]
    convs += [(f"backbone.conv{i + 1}", 3, b[i - 1], b[i]) for i in (2, 3, 4)]
    if e:
        convs.append(("dr.e2.0", e["kernel"], b[4], e["width"]))
    for task in ("cls", "reg"):
        n = w[f"neck_{task}"]
        for branch in ("template", "search"):
            convs.append((f"neck.{branch}_{task}", 3, e["width"] if e else b[4], n))
        tower = [n] + w[f"head_{task}"]
        convs += [(f"head.{task}{i}", 3, tower[i - 1], tower[i]) for i in (1, 2, 3)]
    convs += [("head.score", 1, w["head_cls"][2], 1), ("head.centerness", 1, w["head_cls"][2], 1)]
    convs += [("head.offsets", 1, w["head_reg"][2], 4)]
    weights = {f"{name}.weight": [cout, k, k, cin] for name, k, cin, cout in convs}
    return weights | {f"{name}.bias": [cout] for name, _, _, cout in convs}


def dtype(name, storage):
    """The type in which a tensor is stored."""
    return "F16" if storage == "f16" and name.endswith(".weight") else "F32"


def read(path):
    """The metadata object and a dict of float32 arrays."""
    data = open(path, "rb").read()
    (n,) = struct.unpack("<Q", data[:8])
    header, data = json.loads(data[8 : 8 + n]), data[8 + n :]
    meta = json.loads(header.pop("__metadata__")["track-cpu"])
    assert meta["format_version"] == 1, meta["format_version"]
    expected, tensors, end = shapes(meta["architecture"]), {}, 0
    assert header.keys() == expected.keys(), header.keys() ^ expected.keys()
    for name, info in sorted(header.items(), key=lambda item: item[1]["data_offsets"]):
        assert info["shape"] == expected[name], name
        assert info["dtype"] == dtype(name, meta["storage"]), name
        begin, until = info["data_offsets"]
        assert begin == end, name
        array = np.frombuffer(data[begin:until], DTYPES[info["dtype"]]).reshape(info["shape"])
        assert np.isfinite(array).all(), name
        tensors[name], end = array.astype(np.float32), until
    assert end == len(data), "bytes after the last tensor"
    return meta, tensors


def write(path, meta, tensors):
    """Writes a file of a metadata object and a dict of arrays."""
    header, blobs, end = {"__metadata__": {"track-cpu": json.dumps(meta)}}, [], 0
    kinds = {name: dtype(name, meta["storage"]) for name in shapes(meta["architecture"])}
    order = sorted(shapes(meta["architecture"]).items(), key=lambda item: kinds[item[0]])
    for name, shape in reversed(order):  # F32 before F16 keeps every tensor aligned
        kind = kinds[name]
        array = np.asarray(tensors[name]).astype(DTYPES[kind])
        assert list(array.shape) == shape and np.isfinite(array).all(), name
        header[name] = {"dtype": kind, "shape": shape, "data_offsets": [end, end + array.nbytes]}
        blobs.append(array.tobytes())
        end += array.nbytes
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    with open(path, "wb") as file:
        file.write(struct.pack("<Q", len(text)) + text + b"".join(blobs))


if __name__ == "__main__":
    meta, tensors = read(sys.argv[1])
    print(meta["provenance"]["name"], sum(a.size for a in tensors.values()), "values")
    write(sys.argv[2], meta, tensors)
