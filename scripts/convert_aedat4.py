#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Converts an AEDAT4 recording (DV, DAVIS and DVXplorer cameras) to the HDF5 events that JADE-GS reads.

    scripts/convert_aedat4.py recording.aedat4 events.h5 [--frames FOLDER]

events.h5 contains 1-D data sets x, y (uint16), t (int64, microseconds) and p (int8, 0 or 1), chunked and
compressed, as `events.h5` of the EvDeblur layout. --frames also writes the frames as PNG and their exposure times
as timestamps.npz (timestamps, timestamps_start, timestamps_end; microseconds).

AEDAT4 is read by one of two packages, whichever is installed: dv-processing or aedat. Also needed: h5py and
numpy, and opencv-python-headless for --frames.

    .venv/bin/python -m pip install dv-processing h5py      (or: aedat h5py)
    .venv/bin/python scripts/convert_aedat4.py ...
"""
import argparse
import contextlib
import datetime
import os
import struct
import sys
import xml.etree.ElementTree

CHUNK = 1 << 20
MAGIC = b"#!AER-DAT4.0\r\n"
KINDS = {"EVTS": "events", "FRME": "frame", "TRIG": "triggers"}
COPY_AGAIN = "the file is damaged or was cut short, copy it again"


class NoSuchStream(Exception):
    """The recording lacks the stream or camera that the user chose."""


def fail(message, code=2):
    print(f"convert_aedat4: {message}", file=sys.stderr)
    sys.exit(code)


def reason(error):
    """Reduces the message to one line: dv-processing adds positions in its code before and after it."""
    return str(error).partition("\nStacktrace")[0].rpartition("\n")[2]


def need(module, package):
    try:
        return __import__(module)
    except ImportError:
        fail(f"needs the Python package {package}: {sys.executable} -m pip install {package}")


def header_fields(header):
    """Reads the file's IOHeader, a table of FlatBuffers: the compression, the end of the packets (0 or less: the end
    of the file), and the description of the streams. Raises struct.error for offsets beyond it.
    """
    def number(form, at):
        if at < 0:  # struct would count from the end
            raise struct.error
        return struct.unpack_from("<" + form, header, at)[0]

    table = number("I", 0)
    fields = table - number("i", table)

    def place(index):
        known = 4 + 2 * index < number("H", fields)
        offset = number("H", fields + 4 + 2 * index) if known else 0
        return table + offset if offset else None

    compression, end, text = (place(index) for index in range(3))
    description = b""
    if text is not None:
        text += number("I", text)
        description = struct.unpack_from(f"<{number('I', text)}s", header, text + 4)[0]
    return 0 if compression is None else number("i", compression), -1 if end is None else number("q", end), description


def read_header(file, size):
    """Returns the end of the packets and the streams: {number: {"type", "source"}}, with the name of the camera as
    the source, or "". Raises ValueError for damage on which the packages would end the whole interpreter.
    """
    if file.read(len(MAGIC)) != MAGIC:
        raise ValueError(f"expected an AEDAT4 recording, found a file that does not begin with {MAGIC.decode().strip()}")
    length = int.from_bytes(file.read(4), "little")
    if not 0 < length <= size - file.tell():
        raise ValueError(f"expected a header within the {size} bytes of the file, found one of {length}; {COPY_AGAIN}")
    try:
        compression, end, description = header_fields(file.read(length))
        root = xml.etree.ElementTree.fromstring(description.decode())
    except (struct.error, UnicodeDecodeError, xml.etree.ElementTree.ParseError):
        raise ValueError(f"expected a header that describes the streams, found one that cannot be read; {COPY_AGAIN}") from None
    if not 0 <= compression <= 4:
        raise ValueError(f"expected a compression from 0 to 4, found {compression}; {COPY_AGAIN}")
    streams = {int(node.get("name")): {"type": KINDS.get(node.findtext("attr[@key='typeIdentifier']")),
                                       "source": node.findtext("node[@name='info']/attr[@key='source']") or ""}
               for node in root.iterfind(".//node[@name='outInfo']/node") if node.get("name", "").isdecimal()}
    return end if 0 < end <= size else size, streams


def check_file(path):
    """Returns the streams as read_header() does. Raises ValueError for sizes of packets beyond the file too."""
    size = os.path.getsize(path)
    with open(path, "rb") as file:
        end, streams = read_header(file, size)
        while (at := file.tell()) < end:
            head = file.read(8)
            length = struct.unpack("<ii", head)[1] if len(head) == 8 else -1
            if not 0 <= length <= end - at - 8:
                raise ValueError(f"the packet at byte {at} does not end within the recording; {COPY_AGAIN}")
            file.seek(length, os.SEEK_CUR)
    return streams


@contextlib.contextmanager
def standard_error_closed():
    """Closes standard error for non-Python code too: aedat prints where in its code it failed."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def aedat_packets(decoder):
    """Packets of a decoder of the aedat package. Its failures within a packet are not derived from Exception, so
    `except Exception` would miss them.
    """
    packets = iter(decoder)
    while True:
        try:
            with standard_error_closed():
                packet = next(packets, None)
        except BaseException as error:
            if type(error).__name__ != "PanicException":
                raise
            raise RuntimeError(f"a packet cannot be decoded; {COPY_AGAIN}") from None
        if packet is None:
            return
        yield packet


def dv_reader(path, events="", frames=""):
    """Opens one camera through dv-processing, which reads no second one. Returns the reader and notes on the rest."""
    import dv_processing as dv

    with open(path, "rb") as file:
        _, streams = read_header(file, os.path.getsize(path))
    chosen = chosen_streams(streams, events, frames)
    camera = next((streams[number]["source"] for number in chosen.values()), "")
    own = {kind: number for kind, number in chosen.items() if streams[number]["source"] == camera}
    return dv.io.MonoCameraRecording(path, camera), list(stream_notes(streams, own))


def report(path, notes):
    for note in notes:
        print(f"convert_aedat4: {path}: {note}", file=sys.stderr)


def packets_from_dv_file(path):
    reader, notes = dv_reader(path)
    report(path, notes)
    yield from packets_from_dv(reader)


def packets_from_dv(reader):
    """Yields ("events", x, y, t, p) and ("frame", image, start, end) through dv-processing. Images are gray, BGR or
    BGRA, for OpenCV; start and end are those of the exposure, equal if the recording has none.
    """
    # One stream after the other, because isRunning() ends with the shorter of them.
    if reader.isEventStreamAvailable():
        while (batch := reader.getNextEventBatch()) is not None:
            events = batch.numpy()
            yield "events", events["x"], events["y"], events["timestamp"], events["polarity"]
    if reader.isFrameStreamAvailable():
        while (frame := reader.getNextFrame()) is not None:
            # The start of the exposure, also for DV's older files, which store its middle.
            start = frame.timestamp
            yield "frame", frame.image, start, start + frame.exposure // datetime.timedelta(microseconds=1)


def to_opencv(pixels, order):
    """The aedat package returns RGB."""
    import numpy

    channels = {"RGB": [2, 1, 0], "RGBA": [2, 1, 0, 3]}.get(order)
    return pixels if channels is None else numpy.ascontiguousarray(pixels[..., channels])


def chosen_streams(streams, events="", frames=""):
    """Selects one stream of each kind: {kind: number}. They come from the first camera with events and frames, else
    from the first; a kind that it lacks comes from another. events and frames choose by number or camera.
    """
    numbers = {kind: [n for n in sorted(streams) if streams[n]["type"] == kind] for kind in KINDS.values()}
    cameras = {kind: [streams[n]["source"] for n in numbers[kind]] for kind in numbers}
    found = {}
    for kind, wanted in (("events", events), ("frame", frames)):
        if not wanted:
            continue
        found[kind] = next((n for n in numbers[kind] if wanted in (str(n), streams[n]["source"])), None)
        if found[kind] is None:
            listed = ", ".join(f"{n} ({streams[n]['source']})" for n in numbers[kind]) or "none"
            raise NoSuchStream(f"expected the number or camera of a stream of {kind}, found {wanted}; there are {listed}")
    both = [camera for camera in cameras["events"] if camera in cameras["frame"]]
    every = both + cameras["events"] + cameras["frame"] + cameras["triggers"]
    camera = streams[next(iter(found.values()))]["source"] if found else next(iter(every), "")
    for kind in numbers:
        if kind not in found and numbers[kind]:
            found[kind] = min(numbers[kind], key=lambda n: (streams[n]["source"] != camera, n))
    return found


def stream_notes(streams, chosen):
    """Names the streams that are not read, and the cameras if they are two."""
    def name(number):
        camera = streams[number]["source"]
        return f"{number} ({streams[number]['type']}" + (f" of {camera})" if camera else ")")
    left = [number for number in sorted(streams) if streams[number]["type"] and number not in chosen.values()]
    if left:
        yield "only one stream of each kind is read; left out: " + ", ".join(name(number) for number in left)
    cameras = {kind: streams[chosen[kind]]["source"] for kind in ("events", "frame") if kind in chosen}
    if len(set(cameras.values())) > 1:
        yield f"events are of {cameras['events'] or 'an unnamed camera'}, frames of {cameras['frame'] or 'an unnamed camera'}"


def packets_from_aedat(path):
    """Yields the packets of packets_from_dv() through the aedat package."""
    import aedat

    streams = check_file(path)
    chosen = chosen_streams(streams)
    report(path, stream_notes(streams, chosen))
    for packet in aedat_packets(aedat.Decoder(path)):
        if packet["stream_id"] not in chosen.values():
            continue
        if "events" in packet:
            events = packet["events"]
            yield "events", events["x"], events["y"], events["t"], events["on"]
        if "frame" in packet:
            frame = packet["frame"]
            start, end = frame["exposure_begin_t"], frame["exposure_end_t"]
            if end <= start:
                start = end = frame["t"]
            yield "frame", to_opencv(frame["pixels"], frame["format"]), start, end


def packets(path):
    for module, read in (("dv_processing", packets_from_dv_file), ("aedat", packets_from_aedat)):
        try:
            __import__(module)
        except ImportError:
            continue
        return read(path)
    fail(f"needs dv-processing or aedat to read AEDAT4: {sys.executable} -m pip install dv-processing (or: aedat)")


# HDF5's cache of unpacked chunks: larger than the current chunk, which it would otherwise unpack and pack again for
# every batch of a few hundred events.
CACHE_BYTES = 1 << 24


class EventWriter:
    """Appends batches to resizable data sets, so that memory does not grow with the recording."""

    def __init__(self, file):
        types = {"x": "uint16", "y": "uint16", "t": "int64", "p": "int8"}
        self.sets = {
            name: file.create_dataset(name, (0,), dtype=kind, maxshape=(None,), chunks=(CHUNK,),
                                      compression="gzip", compression_opts=4, shuffle=True)
            for name, kind in types.items()
        }
        self.count, self.last, self.unsorted = 0, None, False

    def append(self, x, y, t, p):
        n = len(t)
        if n == 0:
            return
        for name, values in zip("xytp", (x, y, t, p)):
            data = self.sets[name]
            data.resize((self.count + n,))
            data[self.count:] = values
        self.unsorted |= self.last is not None and int(t[0]) < self.last
        self.last = int(t[-1])
        self.count += n


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("input", help="recording.aedat4")
    parser.add_argument("output", help="events.h5")
    parser.add_argument("--frames", metavar="FOLDER", help="also write frames and timestamps.npz here")
    options = parser.parse_args()
    if not os.path.isfile(options.input):
        fail(f"{options.input}: no such file", 3)
    h5py, numpy = need("h5py", "h5py"), need("numpy", "numpy")
    cv2 = need("cv2", "opencv-python-headless") if options.frames else None
    folder = os.path.dirname(options.output)
    if os.path.isdir(options.output) or (folder and not os.path.isdir(folder)):
        fail(f"{options.output}: expected a file to write in a folder that is there, such as events.h5")
    if options.frames:
        try:
            os.makedirs(options.frames, exist_ok=True)
        except OSError as error:
            fail(f"{options.frames}: the folder of the frames cannot be made: {error.strerror}", 3)

    starts, ends = [], []
    temporary = options.output + ".part"
    try:
        file = h5py.File(temporary, "w", rdcc_nbytes=CACHE_BYTES)
    except OSError as error:
        fail(f"{options.output}: cannot be written: {reason(error)}", 3)
    try:
        with file:
            writer = EventWriter(file)
            for kind, *values in packets(options.input):
                if kind == "events":
                    writer.append(*values)
                elif cv2 is not None:
                    image, start, end = values
                    if not cv2.imwrite(os.path.join(options.frames, f"{len(starts):04d}.png"), image):
                        raise OSError(f"{options.frames}: an image cannot be written; check the free space")
                    starts.append(start)
                    ends.append(end)
        if starts:
            starts, ends = numpy.array(starts), numpy.array(ends)
            numpy.savez(os.path.join(options.frames, "timestamps.npz"), timestamps=(starts + ends) // 2,
                        timestamps_start=starts, timestamps_end=ends)
        os.replace(temporary, options.output)
    except KeyboardInterrupt:
        fail("interrupted", 130)
    except (RuntimeError, ValueError, OSError) as error:
        fail(f"{options.input}: {reason(error)}", 3)
    finally:
        # After a failure, or without a package, no file remains.
        if os.path.exists(temporary):
            os.remove(temporary)
    print(f"{options.output}: {writer.count} events" + (f", {len(starts)} frames" if len(starts) else ""))
    unknown = sum(int(start >= end) for start, end in zip(starts, ends))
    if unknown:
        print(f"{unknown} of {len(starts)} frames carry no exposure times (an accumulator's do not): their start and end "
              "are equal, which JADE-GS takes for sharp test views", file=sys.stderr)
    if writer.unsorted:
        print("some batches were not in order of time; loading sorts them", file=sys.stderr)


if __name__ == "__main__":
    main()
