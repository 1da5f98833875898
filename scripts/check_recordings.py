#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads recordings of real cameras twice, with this project's readers and with independent ones, and compares the
results.

    scripts/check_recordings.py RECORDINGS [MORE ...] [--inspect build/bin/jade_inspect] [--csv OUT.csv]

RECORDINGS are recordings or folders of them; files *.md and *.yaml beside them are ignored. Exit code 1:
something differs, 3: a recording cannot be compared.

This project's readers are jade_inspect --json and, for the events themselves, the stage `read` of the jade_import
beside it. The independent ones:

    AEDAT4          dv-processing, iniVation's own (here: the package aedat)
    Prophesee .raw  faery; numpy for the trigger words, which it omits (here: C++)
    bags            the records of ROS 1 and the sqlite3 tables of ROS 2 parsed in this script, their packets by
    faery (here:
                    the package rosbags, and C++). Only messages of event_camera_msgs/EventPacket.
    RPG folder      numpy.loadtxt (here: C++)

Compares the number of events and each event's place, time and polarity, in order of time (and thus first and last
time, ranges and shares), the sensor's size, the start and end of each frame, and the time of each trigger edge.
Times are whole microseconds.

scripts/setup.sh does not install the independent readers; install them in a separate environment:

    python3 -m venv build/readers && build/readers/bin/pip install dv-processing==2.0.4 faery==0.7.1 h5py
    build/readers/bin/python scripts/check_recordings.py ...
"""
from __future__ import annotations

import argparse
import bz2
import csv
import datetime
import json
import re
import sqlite3
import struct
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

try:
    import h5py
    import numpy as np
except ImportError as missing:
    print(f"check_recordings: needs the Python package {missing.name}: pip install {missing.name}", file=sys.stderr)
    sys.exit(3)

ROOT = Path(__file__).resolve().parents[1]
PASSED_OVER = (".md", ".yaml")
WORD_BYTES = {"evt2": 4, "evt3": 2}
# EVT has 11 bits per coordinate; faery needs a size if the header has none.
LARGEST_SENSOR = (1 << 11, 1 << 11)
# Number of frames that jade_import needs to keep all events; their content is irrelevant.
FRAMES = 4
COLUMNS = ("file", "format", "reader", "independent_reader", "events", "frames", "triggers", "first_s", "last_s", "positive_share",
           "x_min", "x_max", "y_min", "y_max", "equal")


class Problem(Exception):
    """Why a recording cannot be compared, in one line."""


@dataclass
class Contents:
    """Content of a recording according to one reader; events in order of time."""

    reader: str
    events: dict = field(default_factory=dict)  # x, y, t (us), p (0 or 1)
    frames: list = field(default_factory=list)  # (start, end), us
    rising: list = field(default_factory=list)  # us
    falling: list = field(default_factory=list)
    size: tuple = (0, 0)  # of the sensor; 0 where the recording does not say
    form: str = ""

    def take(self, x, y, t, p):
        order = np.argsort(np.asarray(t).astype(np.int64), kind="stable")
        self.events = {name: np.asarray(values).astype(np.int64)[order] for name, values in zip("xytp", (x, y, t, p))}


def need(module, package):
    try:
        return __import__(module)
    except ImportError as error:
        raise Problem(f"needs the Python package {package}: pip install {package}") from error


# ---- independent readers


def joined(path, batches):
    if not batches:
        raise Problem(f"{path}: holds no events")
    return np.concatenate(batches)


def with_dv(path):
    dv = need("dv_processing", "dv-processing")
    reader = dv.io.MonoCameraRecording(str(path))
    found = Contents("dv-processing", size=tuple(reader.getEventResolution()))
    batches = []
    while (batch := reader.getNextEventBatch()) is not None:
        batches.append(batch.numpy().copy())
    events = joined(path, batches)
    found.take(events["x"], events["y"], events["timestamp"], events["polarity"])
    while reader.isFrameStreamAvailable() and (frame := reader.getNextFrame()) is not None:
        length = frame.exposure // datetime.timedelta(microseconds=1)
        found.frames.append((frame.timestamp, frame.timestamp + length))
    edges = {dv.TriggerType.EXTERNAL_SIGNAL_RISING_EDGE: found.rising, dv.TriggerType.EXTERNAL_SIGNAL_FALLING_EDGE: found.falling}
    while reader.isTriggerStreamAvailable() and (batch := reader.getNextTriggerBatch()) is not None:
        for trigger in batch:
            edges.get(trigger.type, []).append(trigger.timestamp)
    return found


def trigger_edges(data, version):
    """Times of the rising and of the falling edges in a stream of EVT2 or EVT3 words without wraps of its counter."""
    words = np.frombuffer(data[:len(data) // WORD_BYTES[version] * WORD_BYTES[version]], f"<u{WORD_BYTES[version]}").astype(np.int64)
    kind_bits, high_bits = (28, 28) if version == "evt2" else (12, 12)
    kinds = words >> kind_bits

    def last(kind):
        """The value of the latest word of that kind, for each word."""
        where = np.maximum.accumulate(np.where(kinds == kind, np.arange(len(words)), 0))
        return words[where] & ((1 << high_bits) - 1)

    high = last(8)
    if (np.diff(high[np.flatnonzero(kinds == 8)]) < 0).any():
        raise Problem("the counter wraps or steps back, which this reader of triggers does not know")
    times = high << 6 | words >> 22 & 63 if version == "evt2" else high << 12 | last(6)
    return [sorted(times[(kinds == 10) & (words & 1 == level)].tolist()) for level in (1, 0)]


def with_faery(path):
    faery = need("faery", "faery")
    content = path.read_bytes()
    with faery.evt.Decoder(str(path), LARGEST_SENSOR, None) as decoder:
        version = decoder.version
        if version not in WORD_BYTES:
            raise Problem(f"{path}: expected EVT2 or EVT3, found {version}")
        batches = [packet["events"] for packet in decoder if "events" in packet]
    header = re.match(rb"(?:% [^\n]*\n)*", content)
    found = Contents("faery, numpy")
    size = re.search(rb"^% geometry (\d+)x(\d+)", header[0], re.M)
    found.size = (int(size[1]), int(size[2])) if size else (0, 0)
    events = joined(path, batches)
    found.take(events["x"], events["y"], events["t"], events["on"])
    found.rising, found.falling = trigger_edges(content[header.end():], version)
    return found


class Message:
    """Reads the fields of a serialised message in sequence; CDR (ROS 2) aligns them, ROS 1 does not."""

    def __init__(self, data, aligned):
        self.data, self.aligned, self.at = data, aligned, 4 if aligned else 0

    def number(self, form):
        size = struct.calcsize("<" + form)
        if self.aligned:
            self.at += -(self.at - 4) % size
        self.at += size
        return struct.unpack_from("<" + form, self.data, self.at - size)[0]

    def bytes(self):
        length = self.number("I")
        self.at += length
        return self.data[self.at - length:self.at]


def packet_of(data, aligned):
    """Encoding, size and words of an event_camera_msgs/EventPacket."""
    message = Message(data, aligned)
    for form in ("II" if aligned else "III"):  # the stamp, and in ROS 1 a number before it
        message.number(form)
    message.bytes()
    height, width = message.number("I"), message.number("I")
    message.number("Q"), message.number("Q")
    encoding = message.bytes().rstrip(b"\0").decode()
    message.number("B")
    words = message.bytes()
    if message.at != len(data):
        raise Problem(f"an event packet ends at {message.at} of {len(data)} bytes")
    return encoding, (width, height), words


def with_packets(path, messages, aligned):
    """Decodes (type, data) in order of time, through a .raw file."""
    packets = []
    for kind, data in messages:
        if not kind.endswith("/EventPacket"):
            raise Problem(f"{path}: messages of {kind} are not read here")
        packets.append(packet_of(data, aligned))
    kinds = {(encoding, size) for encoding, size, _ in packets}
    if len(kinds) != 1:
        raise Problem(f"{path}: expected packets of one encoding and size, found {kinds or 'none'}")
    encoding, (width, height) = kinds.pop()
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "words.raw"
        raw.write_bytes(f"% evt {encoding[3:]}.0\n% geometry {width}x{height}\n% end\n".encode() + b"".join(p[2] for p in packets))
        return with_faery(raw)


def fields_of(header):
    found, at = {}, 0
    while at < len(header):
        end = at + 4 + struct.unpack_from("<I", header, at)[0]
        name, _, value = header[at + 4:end].partition(b"=")
        found[name.decode()], at = value, end
    return found


def records_of(data, at=0):
    """Header fields and bytes of each record of a ROS 1 bag, including those in chunks."""
    while at < len(data):
        parts = []
        for _ in range(2):
            end = at + 4 + struct.unpack_from("<I", data, at)[0]
            parts.append(data[at + 4:end])
            at = end
        header, content = fields_of(parts[0]), parts[1]
        yield header, content
        if header["op"] == b"\x05":
            unpack = {b"none": bytes, b"bz2": bz2.decompress}.get(header["compression"])
            if unpack is None:
                raise Problem(f"chunks compressed by {header['compression'].decode()} are not read here")
            yield from records_of(unpack(content))


def with_ros1(path):
    kinds, messages = {}, []
    for header, content in records_of(path.read_bytes(), len(b"#ROSBAG V2.0\n")):
        if header["op"] == b"\x07":
            kinds[header["conn"]] = fields_of(content)["type"].decode()
        elif header["op"] == b"\x02":
            messages.append((struct.unpack("<II", header["time"]), kinds[header["conn"]], content))
    messages.sort(key=lambda message: message[0])
    found = with_packets(path, [message[1:] for message in messages], False)
    found.reader = "own record parser, " + found.reader
    return found


def with_ros2(path):
    # immutable: allows a folder that cannot be written
    store = sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True)
    messages = store.execute("select type, data from messages join topics on topics.id = topic_id order by timestamp, messages.id")
    found = with_packets(path, messages.fetchall(), True)
    found.reader = "sqlite3, own CDR, " + found.reader
    return found


def with_numpy(path):
    t, x, y, p = np.loadtxt(path / "events.txt", unpack=True, ndmin=2)
    found = Contents("numpy.loadtxt")
    found.take(x, y, np.round(1e6 * t), p)
    images = path / "images.txt"
    if images.exists():
        stamps = [round(1e6 * float(line.split()[0])) for line in images.read_text().splitlines() if line.strip()]
        found.frames = [(stamp, stamp) for stamp in stamps]
    return found


def independent(path):
    """Reads the recording with the independent reader of its kind."""
    if path.is_dir():
        return with_numpy(path)
    with open(path, "rb") as file:
        start = file.read(16)
    for magic, read in ((b"#!AER-DAT4", with_dv), (b"#ROSBAG V2.0", with_ros1), (b"SQLite format 3", with_ros2), (b"% ", with_faery)):
        if start.startswith(magic):
            return read(path)
    raise Problem(f"{path}: no independent reader for what begins with {start!r}")


# ---- this project's readers


def run(*command):
    done = subprocess.run([str(word) for word in command], cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        raise Problem(f"{Path(command[0]).name} ended with {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def ours(path, inspect, span):
    """Content of a recording according to this project's readers, and differences between them. span: first and last
    time of the independent reader's events, us.
    """
    said = json.loads(run(inspect, "--json", path))
    packages = {"AEDAT4": "aedat", "ROS bag": "rosbags, own decoder"}
    found = Contents(packages.get(said["format"], "own decoder"), form=said["format"], size=(said["width"], said["height"]),
                     frames=[(frame["t_start_us"], frame["t_end_us"]) for frame in said["frames"]],
                     rising=said["rising_us"], falling=said["falling_us"])
    first, last = (round(1e6 * said[name]) for name in ("first_s", "last_s"))
    begin, end = min(first, span[0]), max(last, span[1]) + 1
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "frames"
        folder.mkdir()
        cuts = [begin + (end - begin) * i // FRAMES for i in range(FRAMES + 1)]
        lines = [f"{i},{cuts[i]},{cuts[i + 1]}" for i in range(FRAMES)]
        (folder / "exposures.csv").write_text("\n".join(["name,start_us,end_us", *lines]) + "\n")
        for i in range(FRAMES):
            width, height = found.size if found.size[0] else LARGEST_SENSOR
            (folder / f"{i}.pgm").write_bytes(b"P5\n%d %d\n255\n" % (width, height) + bytes(width * height))
        run(inspect.with_name("jade_import"), path, "--frames", folder, "--until", "read", "--quiet", "--output", f"{temporary}/data")
        with h5py.File(f"{temporary}/data/import/read/events.h5") as file:
            x, y, t, p = (file[name][:] for name in "xytp")
    found.take(x, y, t, p > 0)
    summary = (said["events"], first, last, round(said["positive_share"] * said["events"]))
    kept = (len(t), int(t.min()), int(t.max()), int((p > 0).sum()))
    unequal = [] if summary == kept else [f"(events, first, last, positive): {summary} by jade_inspect, {kept} by jade_import"]
    return found, unequal


# ---- the comparison


def numbers_of(contents):
    events = contents.events
    numbers = {"events": len(events["t"]), "frames": len(contents.frames), "triggers": len(contents.rising) + len(contents.falling),
               "first_s": f"{events['t'][0] / 1e6:.6f}", "last_s": f"{events['t'][-1] / 1e6:.6f}",
               "positive_share": f"{events['p'].mean():.6f}"}
    for name in "xy":
        numbers[f"{name}_min"], numbers[f"{name}_max"] = int(events[name].min()), int(events[name].max())
    return numbers


def differences(mine, other):
    """Differences, one line each."""
    found = []
    a, b = numbers_of(mine), numbers_of(other)
    found += [f"{name}: {a[name]} by ours, {b[name]} by {other.reader}" for name in a if a[name] != b[name]]
    # jade_inspect may know a size that the recording does not store.
    if mine.size != other.size and other.size != (0, 0):
        found.append(f"size: {mine.size} by ours, {other.size} by {other.reader}")
    for name in ("frames", "rising", "falling"):
        one, two = getattr(mine, name), getattr(other, name)
        if len(one) != len(two):
            found.append(f"{name}: {len(one)} by ours, {len(two)} by {other.reader}")
        found += [f"{name}, {i}: {u} by ours, {v} by {other.reader}" for i, (u, v) in enumerate(zip(one, two)) if u != v][:1]
    if a["events"] == b["events"]:
        for name in "xytp":
            unequal = np.flatnonzero(mine.events[name] != other.events[name])
            if len(unequal):
                i = unequal[0]
                found.append(f"{name} of {len(unequal)} events, first of event {i}: {mine.events[name][i]} by ours, "
                             f"{other.events[name][i]} by {other.reader}")
    return found


def recordings_in(paths):
    for path in paths:
        if path.is_dir() and not (path / "events.txt").exists():
            yield from sorted(p for p in path.iterdir() if p.suffix not in PASSED_OVER)
        else:
            yield path


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("recordings", nargs="+", type=Path, help="recordings, or folders of them")
    parser.add_argument("--inspect", type=Path, default=ROOT / "build/bin/jade_inspect", help="our reader; jade_import lies beside it")
    parser.add_argument("--csv", type=Path, help="write the table here")
    options = parser.parse_args()
    rows, differs = [], []
    try:
        for path in recordings_in(options.recordings):
            other = independent(path)
            mine, found = ours(path.resolve(), options.inspect.resolve(), (other.events["t"][0], other.events["t"][-1]))
            found += differences(mine, other)
            differs += [f"{path.name}: {line}" for line in found]
            row = {"file": path.name, "format": mine.form, "reader": mine.reader, "independent_reader": other.reader,
                   **numbers_of(mine), "equal": "no" if found else "yes"}
            rows.append([str(row[name]) for name in COLUMNS])
    except (Problem, OSError) as problem:
        print(f"check_recordings: {problem}", file=sys.stderr)
        sys.exit(3)
    widths = [max(len(row[i]) for row in [COLUMNS, *rows]) for i in range(len(COLUMNS))]
    for row in [COLUMNS, *rows]:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip())
    for line in differs:
        print(f"differs: {line}")
    if options.csv:
        with open(options.csv, "w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
    sys.exit(1 if differs else 0)


if __name__ == "__main__":
    main()
