#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads the files of jade_export with independent readers, written by the formats' public descriptions
(.spz: github.com/nianticlabs/spz, README, "File Format"; .splat: 32 bytes per Gaussian; .ply: the 3DGS
attributes; .glb: glTF 2.0 with KHR_gaussian_splatting), and compares. Then converts every format back to .ply
with jade_export, and checks that jade_inspect recognises it. Standard library only.

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


def check_smallest_three(packed, xyzw):
    """Two bits for the largest component, then a sign and nine bits in [0, 1/√2] for each other one."""
    largest = packed >> 30
    assert abs(abs(xyzw[largest]) - max(abs(v) for v in xyzw)) < 1e-6, "the largest component"
    sign = 1 if xyzw[largest] > 0 else -1
    for place, k in enumerate(k for k in range(4) if k != largest):
        field = packed >> (20 - 10 * place) & 1023
        value = (field & 511) / 511 * math.sqrt(0.5) * (-1 if field & 512 else 1)
        near(value, sign * xyzw[k], 0.0008, f"rotation {k}")


def check_glb(path, rows, degree):
    content = path.read_bytes()
    mark, version, length, size, kind = struct.unpack_from("<4sIII4s", content)
    assert (mark, version, length, kind) == (b"glTF", 2, len(content), b"JSON")
    document = json.loads(content[20 : 20 + size])
    binary = content[20 + size + 8 :]
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}

    def attribute(name):
        accessor = document["accessors"][attributes[name]]
        view = document["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126 and accessor["count"] == COUNT
        width = columns[accessor["type"]]
        assert view["byteLength"] == 4 * width * COUNT
        return list(struct.iter_unpack(f"<{width}f", binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]))

    own = "KHR_gaussian_splatting:"
    places, turns = attribute("POSITION"), attribute(own + "ROTATION")
    scales, opacities = attribute(own + "SCALE"), attribute(own + "OPACITY")
    flips = [1] + FLIP
    sh = [attribute(f"{own}SH_DEGREE_{d}_COEF_{i}") for d in range(degree + 1) for i in range(2 * d + 1)]
    per_channel = REST[degree] // 3
    for i, row in enumerate(rows):
        # Right, up, back.
        for axis, (key, sign) in enumerate((("x", 1), ("y", -1), ("z", -1))):
            near(places[i][axis], sign * row[key], 0, f"position {key}")
            near(scales[i][axis], math.exp(row[f"scale_{axis}"]), 1e-6, f"scale {axis}")
        near(opacities[i][0], sigmoid(row["opacity"]), 1e-6, "opacity")
        w, x, y, z = unit_quaternion(row)
        for k, value in enumerate((x, -y, -z, w)):
            near(turns[i][k], value, 1e-6, f"rotation {k}")
        for k in range(1 + per_channel):
            for c in range(3):
                name = f"f_dc_{c}" if k == 0 else f"f_rest_{c * per_channel + k - 1}"
                near(sh[k][i][c], flips[k] * row[name], 0, f"SH {k} {c}")


def check_round_trips(program, folder):
    """Every format can be read again, and is recognised by its content."""
    source = folder / "in3.ply"
    rows = read_ply(source)
    kinds = {"a.spz": ".spz", "a4.spz": ".spz", "a.sog": ".sog", "a.glb": "glTF", "a.splat": ".splat", "a.compressed.ply": "compressed"}
    for name, kind in kinds.items():
        path, back = folder / name, folder / (name + ".back.ply")
        version = ["--spz-version", "4"] if name == "a4.spz" else []
        subprocess.run([program, "--ply", source, "--output", path, "--quiet", *version], check=True)
        subprocess.run([program, "--ply", path, "--output", back, "--quiet"], check=True)
        found = read_ply(back)
        assert len(found) == COUNT, name

        def middle(some, key):
            return sum(row[key] for row in some) / COUNT

        for key in ("x", "y", "z", "scale_0", "f_dc_0"):
            near(middle(found, key), middle(rows, key), 0.2 if key == "f_dc_0" else 0.02, f"{name}: {key}")
        inspect = [str(Path(program).with_name("jade_inspect")), path, "--json", "--quiet"]
        told = json.loads(subprocess.run(inspect, check=True, capture_output=True, text=True).stdout)
        assert told["gaussians"] == COUNT and kind in told["kind"], told
        # A truncated file is rejected in one line that names it.
        path.write_bytes(path.read_bytes()[:-7])
        done = subprocess.run([program, "--ply", path, "--output", back, "--quiet"], capture_output=True, text=True)
        assert done.returncode == 3 and name in done.stderr and done.stderr.count("\n") == 1, done.stderr


def check_spz(path, rows, degree, expected_version=2):
    content = gzip.decompress(path.read_bytes())
    magic, version, count, sh_degree, bits, flags, reserved = struct.unpack_from("<IIIBBBB", content)
    assert (magic, version, count, sh_degree) == (0x5053474E, expected_version, COUNT, degree)
    assert flags in (0, 1) and reserved == 0
    rest = REST[degree]
    rotation = 3 if version == 2 else 4
    assert len(content) == 16 + COUNT * (9 + 1 + 3 + 3 + rotation + rest), "the file's size"
    # Attribute after attribute: positions, alphas, colours, scales, rotations, spherical harmonics.
    at = 16
    blocks = {}
    for name, size in (("position", 9), ("alpha", 1), ("color", 3), ("scale", 3), ("rotation", rotation), ("sh", rest)):
        blocks[name] = [content[at + size * i : at + size * (i + 1)] for i in range(COUNT)]
        at += size * COUNT
    for i, row in enumerate(rows):
        # Right, up, back: the file's axes; the library's are right, down, forward.
        for axis, (key, sign) in enumerate((("x", 1), ("y", -1), ("z", -1))):
            fixed = int.from_bytes(blocks["position"][i][3 * axis : 3 * axis + 3], "little", signed=True)
            near(fixed / 2**bits, sign * row[key], 0.51 / 2**bits, f"position {key}")
            near(blocks["scale"][i][axis] / 16 - 10, row[f"scale_{axis}"], 0.0313, f"scale {axis}")
            color = bounded(row[f"f_dc_{axis}"] * 0.15 + 0.5, 0, 1)
            near(blocks["color"][i][axis] / 255, color, 0.51 / 255, f"colour {axis}")
        near(blocks["alpha"][i][0] / 255, sigmoid(row["opacity"]), 0.51 / 255, "opacity")
        w, x, y, z = unit_quaternion(row)
        if version == 2:
            if w < 0:
                w, x, y, z = -w, -x, -y, -z
            for k, value in enumerate((x, -y, -z)):
                near(blocks["rotation"][i][k] / 127.5 - 1, value, 0.0041, f"rotation {k}")
        else:
            check_smallest_three(int.from_bytes(blocks["rotation"][i], "little"), (x, -y, -z, w))
        per_channel = rest // 3
        for k in range(per_channel):
            for c in range(3):
                # In the file channels vary fastest, in .ply coefficients.
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
            outputs = {ending: folder / f"out{degree}.{ending}" for ending in ("ply", "splat", "spz", "glb")}
            for path in outputs.values():
                subprocess.run([program, "--ply", source, "--output", path, "--quiet"], check=True)
            third = folder / f"third{degree}.spz"
            subprocess.run([program, "--ply", source, "--output", third, "--quiet", "--spz-version", "3"], check=True)
            check_spz(third, rows, degree, 3)
            must_fail(check_spz, third, [dict(row, rot_1=row["rot_1"] + 0.1) for row in rows], degree, 3)
            check_glb(outputs["glb"], rows, degree)
            must_fail(check_glb, outputs["glb"], [dict(row, x=row["x"] + 0.01) for row in rows], degree)
            check_ply(outputs["ply"], rows)
            check_splat(outputs["splat"], rows)
            check_spz(outputs["spz"], rows, degree)
            other = [dict(row, x=row["x"] + 0.01) for row in rows]
            must_fail(check_ply, outputs["ply"], other)
            must_fail(check_splat, outputs["splat"], other)
            must_fail(check_spz, outputs["spz"], other, degree)
        check_left_out(program, folder)
        check_round_trips(program, folder)
    print("ply, splat, spz, glb: SH degrees 0 to 3 read back; every format read again")


if __name__ == "__main__":
    main()
