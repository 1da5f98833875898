#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads what jade_export writes with readers of its own, made from the formats' public descriptions
(.spz: github.com/nianticlabs/spz, README, "File Format"; .splat: 32 bytes per Gaussian; .ply: the 3DGS
attributes), and compares. Standard library only.

    splat_files_test.py path/to/jade_export
"""

import gzip
import json
import math
import random
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

COUNT = 40
REST = {0: 0, 1: 9, 2: 24, 3: 45}
# Signs of the SH coefficients beyond the first when y and z change sign: by degree, then order -l..l.
FLIP = [-1, -1, 1] + [-1, 1, 1, -1, 1] + [-1, 1, -1, -1, 1, -1, 1]


def names(degree):
    rest = [f"f_rest_{i}" for i in range(REST[degree])]
    return (
        ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"]
        + rest
        + ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    )


def draw(degree):
    random.seed(degree)
    rows = []
    for _ in range(COUNT):
        row = {name: random.gauss(0, 1) for name in names(degree)}
        row.update({f"f_rest_{i}": random.uniform(-0.9, 0.9) for i in range(REST[degree])})
        row.update({f"scale_{i}": random.uniform(-6, 0) for i in range(3)})
        rows.append({k: struct.unpack("<f", struct.pack("<f", v))[0] for k, v in row.items()})
    return rows


def write_ply(path, rows, degree):
    keys = names(degree)
    random.shuffle(keys)
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    head += [f"property float {key}" for key in keys] + ["end_header", ""]
    body = b"".join(struct.pack(f"<{len(keys)}f", *(row[key] for key in keys)) for row in rows)
    path.write_bytes("\n".join(head).encode() + body)


def read_ply(path):
    head, body = path.read_bytes().split(b"end_header\n", 1)
    lines = head.decode().splitlines()
    assert lines[1] == "format binary_little_endian 1.0", lines[1]
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    keys = [line.split()[2] for line in lines if line.startswith("property")]
    assert all(line.split()[1] == "float" for line in lines if line.startswith("property"))
    assert len(body) == 4 * count * len(keys), "the file's size"
    rows = struct.iter_unpack(f"<{len(keys)}f", body)
    return [dict(zip(keys, row)) for row in rows]


def unit_quaternion(row):
    q = [row[f"rot_{i}"] for i in range(4)]
    norm = math.sqrt(sum(v * v for v in q))
    return [v / norm for v in q]


def sigmoid(value):
    return 1 / (1 + math.exp(-value))


def near(found, expected, tolerance, what):
    assert abs(found - expected) <= tolerance, f"{what}: expected {expected}, found {found}"


def bounded(value, low, high):
    return min(max(value, low), high)


def check_ply(path, rows):
    found = read_ply(path)
    assert len(found) == COUNT
    for row, other in zip(rows, found):
        for key, value in row.items():
            assert other[key] == value, f"{key}: expected {value}, found {other[key]}"


def check_splat(path, rows):
    """Position and scale as float32, RGBA and the quaternion (w, x, y, z) as bytes; large and opaque
    Gaussians first."""
    content = path.read_bytes()
    assert len(content) == 32 * COUNT

    def importance(row):
        return math.exp(sum(row[f"scale_{i}"] for i in range(3))) * sigmoid(row["opacity"])

    for i, row in enumerate(sorted(rows, key=importance, reverse=True)):
        record = struct.unpack_from("<6f8B", content, 32 * i)
        for axis, key in enumerate("xyz"):
            near(record[axis], row[key], 0, f"position {key}")
            near(record[3 + axis], math.exp(row[f"scale_{axis}"]), 1e-6, f"scale {axis}")
            color = bounded(0.5 + 0.28209479177387814 * row[f"f_dc_{axis}"], 0, 1)
            near(record[6 + axis], 255 * color, 0.51, f"colour {axis}")
        near(record[9], 255 * sigmoid(row["opacity"]), 0.51, "opacity")
        for k, value in enumerate(unit_quaternion(row)):
            near((record[10 + k] - 128) / 128, value, 0.009, f"rotation {k}")


def check_spz(path, rows, degree):
    content = gzip.decompress(path.read_bytes())
    magic, version, count, sh_degree, bits, flags, reserved = struct.unpack_from("<IIIBBBB", content)
    assert (magic, version, count, sh_degree) == (0x5053474E, 2, COUNT, degree)
    assert flags in (0, 1) and reserved == 0
    rest = REST[degree]
    assert len(content) == 16 + COUNT * (9 + 1 + 3 + 3 + 3 + rest), "the file's size"
    # Attribute after attribute: positions, alphas, colours, scales, rotations, spherical harmonics.
    at = 16
    blocks = {}
    for name, size in (("position", 9), ("alpha", 1), ("color", 3), ("scale", 3), ("rotation", 3), ("sh", rest)):
        blocks[name] = [content[at + size * i : at + size * (i + 1)] for i in range(COUNT)]
        at += size * COUNT
    for i, row in enumerate(rows):
        # Right, up, back: the file's axes; ours are right, down, forward.
        for axis, (key, sign) in enumerate((("x", 1), ("y", -1), ("z", -1))):
            fixed = int.from_bytes(blocks["position"][i][3 * axis : 3 * axis + 3], "little", signed=True)
            near(fixed / 2**bits, sign * row[key], 0.51 / 2**bits, f"position {key}")
            near(blocks["scale"][i][axis] / 16 - 10, row[f"scale_{axis}"], 0.0313, f"scale {axis}")
            color = bounded(row[f"f_dc_{axis}"] * 0.15 + 0.5, 0, 1)
            near(blocks["color"][i][axis] / 255, color, 0.51 / 255, f"colour {axis}")
        near(blocks["alpha"][i][0] / 255, sigmoid(row["opacity"]), 0.51 / 255, "opacity")
        w, x, y, z = unit_quaternion(row)
        if w < 0:
            w, x, y, z = -w, -x, -y, -z
        for k, value in enumerate((x, -y, -z)):
            near(blocks["rotation"][i][k] / 127.5 - 1, value, 0.0041, f"rotation {k}")
        per_channel = rest // 3
        for k in range(per_channel):
            for c in range(3):
                # The file runs over channels fastest, .ply over coefficients.
                expected = FLIP[k] * row[f"f_rest_{c * per_channel + k}"]
                step = (8 if k < 3 else 16) / 128
                near((blocks["sh"][i][3 * k + c] - 128) / 128, expected, 0.51 * step + 1 / 128, f"SH {k} {c}")


def must_fail(check, *arguments):
    try:
        check(*arguments)
    except AssertionError:
        return
    raise SystemExit(f"{check.__name__} did not notice a wrong file")


def check_left_out(program, folder):
    """A Gaussian with a number that is not finite is in no picture, and not in files for viewers."""
    rows = draw(1)
    spoilt = rows + [dict(rows[0], opacity=math.nan)]
    source = folder / "spoilt.ply"
    write_ply(source, spoilt, 1)
    for ending, check in (("splat", lambda path: check_splat(path, rows)), ("spz", lambda path: check_spz(path, rows, 1))):
        path = folder / f"spoilt.{ending}"
        done = subprocess.run([program, "--ply", source, "--output", path, "--json"], check=True, capture_output=True, text=True)
        check(path)
        assert json.loads(done.stdout)["gaussians"] == COUNT, done.stdout
        assert f"1 of {COUNT + 1} Gaussians have NaN or Inf" in done.stderr, done.stderr


def main():
    program = sys.argv[1]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for degree in range(4):
            rows = draw(degree)
            source = folder / f"in{degree}.ply"
            write_ply(source, rows, degree)
            outputs = {ending: folder / f"out{degree}.{ending}" for ending in ("ply", "splat", "spz")}
            for path in outputs.values():
                subprocess.run([program, "--ply", source, "--output", path, "--quiet"], check=True)
            check_ply(outputs["ply"], rows)
            check_splat(outputs["splat"], rows)
            check_spz(outputs["spz"], rows, degree)
            other = [dict(row, x=row["x"] + 0.01) for row in rows]
            must_fail(check_ply, outputs["ply"], other)
            must_fail(check_splat, outputs["splat"], other)
            must_fail(check_spz, outputs["spz"], other, degree)
        check_left_out(program, folder)
    print("ply, splat, spz: SH degrees 0 to 3 read back")


if __name__ == "__main__":
    main()
