#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Converts an AEDAT file or a ROS bag to a folder that jade_import and jade_inspect can read.

    .venv/bin/python scripts/read_recording.py recording.aedat4 FOLDER

These programs run this script for such recordings; run it by hand if the packages are on another machine.
scripts/setup.sh --import installs its requirements. recording_folder.py describes FOLDER.

Supports AEDAT4 (packages aedat or dv-processing), AEDAT 3.1 and 2.0 (aedat_legacy.py), and ROS bags (ros_bag.py).
"""
import argparse
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from convert_aedat4 import (COPY_AGAIN, NoSuchStream, aedat_packets, check_file, chosen_streams, dv_reader,  # noqa: E402
                            packets_from_dv, reason, stream_notes, to_opencv)
from recording_folder import DATA_ERROR, Output, Problem, check_space, is_full, need, no_space  # noqa: E402
from ros_bag import read_bag  # noqa: E402


def read_with_aedat(path, out, events_stream, frames_stream):
    import aedat

    streams = check_file(path)
    chosen = chosen_streams(streams, events_stream, frames_stream)
    out.notes += stream_notes(streams, chosen)
    decoder = aedat.Decoder(path)
    if "events" in chosen:
        stream = decoder.id_to_stream()[chosen["events"]]
        out.size = stream["width"], stream["height"]
    for packet in aedat_packets(decoder):
        if packet["stream_id"] not in chosen.values():
            continue
        if "events" in packet:
            events = packet["events"]
            out.events(events["x"], events["y"], events["t"].astype("int64"), events["on"])
        elif "frame" in packet:
            frame = packet["frame"]
            start, end = int(frame["exposure_begin_t"]), int(frame["exposure_end_t"])
            if end <= start:
                start = end = int(frame["t"])
            out.frame(to_opencv(frame["pixels"], frame["format"]), start, end)
        elif "triggers" in packet:
            for trigger in packet["triggers"]:
                # 1 and 2 are the edges at the connector; the others belong to the frames, which contain them.
                if trigger["source"] in (1, 2):
                    out.edges.append((int(trigger["t"]), int(trigger["source"] == 1)))


def read_with_dv(path, out, events_stream, frames_stream):
    reader, notes = dv_reader(path, events_stream, frames_stream)
    out.notes += notes
    if reader.isEventStreamAvailable():
        out.size = tuple(reader.getEventResolution())
    for kind, *values in packets_from_dv(reader):
        if kind == "events":
            x, y, t, p = values
            out.events(x, y, t, p)
        else:
            image, start, end = values
            out.frame(image, start, end)
    while reader.isTriggerStreamAvailable() and (batch := reader.getNextTriggerBatch()) is not None:
        for trigger in batch:
            kind = str(trigger.type)
            if "EXTERNAL_SIGNAL" in kind and "PULSE" not in kind:
                out.edges.append((trigger.timestamp, int("RISING" in kind)))


def read_aedat4(path, folder, events_stream, frames_stream):
    out = Output(folder, "AEDAT4")
    for module, read in (("aedat", read_with_aedat), ("dv_processing", read_with_dv)):
        try:
            __import__(module)
        except ImportError:
            continue
        try:
            read(path, out, events_stream, frames_stream)
        except Problem:
            raise
        except NoSuchStream as error:
            raise Problem(f"{path}: {error}") from error
        except Exception as error:  # the packages have their own exception types
            check_space(error, folder)
            said = reason(error)
            raise Problem(f"{path}: {said}" + ("" if COPY_AGAIN in said else f"; {COPY_AGAIN}")) from error
        return out
    need("aedat", "aedat")


def read_legacy_aedat(path, folder, events_topic, frames_topic):
    if events_topic or frames_topic:
        raise Problem(f"{path}: expected a ROS bag or AEDAT4, of which streams are chosen, found an older AEDAT; leave "
                      "--topic and --frames-topic out")
    need("numpy", "numpy")
    import aedat_legacy

    out = Output(folder, "AEDAT")
    try:
        aedat_legacy.read(path, out)
    except ValueError as error:
        raise Problem(f"{path}: {error}") from error
    return out


def aedat_version(path):
    """The major version digit; empty for other files."""
    head = b""
    if os.path.isfile(path):
        with open(path, "rb") as file:
            head = file.read(10)
    return head[9:].decode("ascii", "replace") if head.startswith(b"#!AER-DAT") else ""


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("input", help="recording.aedat4 or .aedat, a ROS 1 .bag, a ROS 2 .db3, .mcap or folder")
    parser.add_argument("output", help="folder to make")
    parser.add_argument("--events-topic", default="", help="of a bag, or number or camera of a stream of AEDAT4; else the first")
    parser.add_argument("--frames-topic", default="", help="the same for frames; else those of the events' camera")
    parser.add_argument("--stamp", choices=("start", "middle", "end"), default="",
                        help="instant of the exposure that the single time of a frame marks; else that of the format")
    options = parser.parse_args()
    if not os.path.exists(options.input):
        print(f"{options.input}: no such file or folder", file=sys.stderr)
        sys.exit(DATA_ERROR)
    need("numpy", "numpy")
    try:
        version = aedat_version(options.input)
        choice = options.events_topic, options.frames_topic
        if version == "4":
            out = read_aedat4(options.input, options.output, *choice)
        elif version:
            out = read_legacy_aedat(options.input, options.output, *choice)
        else:
            out = read_bag(options.input, options.output, *choice, options.stamp)
        out.stamp = options.stamp or out.stamp
        out.close()
    except Problem as problem:
        print(problem, file=sys.stderr)
        sys.exit(DATA_ERROR)
    except OSError as error:
        print(no_space(options.output) if is_full(error) else error, file=sys.stderr)
        sys.exit(DATA_ERROR)
    print(f"{options.output}: {out.form}, {'a raw stream of' if out.raw else out.event_count} events, "
          f"{len(out.exposures)} frames, {len(out.edges)} trigger edges")


if __name__ == "__main__":
    main()
