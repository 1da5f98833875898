# SPDX-License-Identifier: Apache-2.0
"""Tests of convert_aedat4.py on recordings as the two packages decode them (aedat 2.3.0, dv-processing 2.0.4); stubs
replace the packages, h5py and OpenCV, so that only numpy is needed.
"""
import contextlib
import datetime
import io
import struct
import sys
import tempfile
import types
import unittest
from pathlib import Path
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import convert_aedat4  # noqa: E402
from read_recording_test import aedat4  # noqa: E402

RED, GREEN, BLUE, OPAQUE = 10, 100, 200, 255
MICROSECOND = datetime.timedelta(microseconds=1)
# Middle, start and end of the exposure, µs; the last frame has none (from DV's accumulator).
TIMES = ((1005000, 1000000, 1010000), (2000124, 2000000, 2000249), (3000000, 0, 0))
BATCHES = 5


def image(*channels):
    return np.full((2, 4, len(channels)), channels, np.uint8)


def batch(number, names):
    kinds = list(zip(names, ("<u8", "<u2", "<u2", "?")))
    return np.array([(1000 * number + i, i, 1, i % 2) for i in range(3)], kinds)


# Stubs decode the packets; the file must still have a valid beginning and end.
WHOLE = aedat4([("EVTS", 4, 2), ("FRME", 4, 2), ("EVTS", 4, 2, "DVX")], [(0, [("list", (1, struct.pack("<qhhB3x", 1000, 3, 1, 1)))])])
HEADER_END = 18 + struct.unpack_from("<I", WHOLE, 14)[0]


class AedatDecoder:
    """RGB pixels, exposure times as in the file: 0 if it has none."""

    def __init__(self, path):
        pass

    def __iter__(self):
        yield {"stream_id": 2, "events": batch(7, ("t", "x", "y", "on"))}  # of a second camera
        pixels = {"RGB": image(RED, GREEN, BLUE), "RGBA": image(RED, GREEN, BLUE, OPAQUE), "L": image(RED)[..., 0]}
        for (middle, start, end), (order, values) in zip(TIMES, pixels.items()):
            yield {"stream_id": 1, "frame": {"t": middle, "exposure_begin_t": start, "exposure_end_t": end, "format": order,
                                             "width": 4, "height": 2, "pixels": values}}
        for number in range(BATCHES):
            yield {"stream_id": 0, "events": batch(number, ("t", "x", "y", "on"))}


class DvRecording:
    """BGR pixels, the exposure's start and length, and a recording that ends when its first stream ends."""

    def __init__(self, path, camera):
        assert camera == ""  # the first one in the file
        pixels = (image(BLUE, GREEN, RED), image(BLUE, GREEN, RED, OPAQUE), image(RED)[..., 0])
        self.frames = [types.SimpleNamespace(timestamp=start or middle, exposure=(end - start) * MICROSECOND, image=values)
                       for (middle, start, end), values in zip(TIMES, pixels)]
        self.batches = [types.SimpleNamespace(numpy=lambda n=n: batch(n, ("timestamp", "x", "y", "polarity")))
                        for n in range(BATCHES)]
        self.ended = False

    def isRunning(self):
        return not self.ended

    def isEventStreamAvailable(self):
        return True

    def isFrameStreamAvailable(self):
        return True

    def next_of(self, stream):
        item = stream.pop(0) if stream else None
        self.ended |= not stream
        return item

    def getNextEventBatch(self):
        return self.next_of(self.batches)

    def getNextFrame(self):
        return self.next_of(self.frames)


class FailingRecording:
    def __init__(self, path, camera):
        raise RuntimeError("/include/simplefile.hpp(313): void read()\nEndOfFile: Error info: it is empty\nStacktrace:\n 0# 0x3A")


class Hdf5File:
    """The part of h5py.File that the converter uses; the data sets stay in `written`."""

    written = {}

    def __init__(self, path, mode, rdcc_nbytes):
        Path(path).touch()

    def __enter__(self):
        return self

    def __exit__(self, *problem):
        pass

    def create_dataset(self, name, shape, dtype, **options):
        return Hdf5Set(name, dtype)


class Hdf5Set:
    def __init__(self, name, dtype):
        self.name, Hdf5File.written[name] = name, np.zeros(0, dtype)

    def resize(self, shape):
        Hdf5File.written[self.name] = np.resize(Hdf5File.written[self.name], shape)

    def __setitem__(self, where, values):
        Hdf5File.written[self.name][where] = values


def module(name, **content):
    return {name: types.SimpleNamespace(**content)}


READERS = {"aedat": module("aedat", Decoder=AedatDecoder) | {"dv_processing": None},
           "dv_processing": module("dv_processing", io=types.SimpleNamespace(MonoCameraRecording=DvRecording))}


class ConvertAedat4(unittest.TestCase):
    def convert(self, reader, room=9, content=WHOLE, output="events.h5"):
        """Exit code, output, the pictures (there is space for `room` of them), and the times."""
        pictures = {}

        def imwrite(path, values):
            if len(pictures) < room:
                pictures[Path(path).name] = values
            return Path(path).name in pictures

        stubs = module("h5py", File=Hdf5File) | module("cv2", imwrite=imwrite)
        said = io.StringIO()
        with tempfile.TemporaryDirectory() as folder:
            recording = Path(folder) / "recording.aedat4"
            recording.write_bytes(content)
            arguments = ["convert_aedat4", str(recording), f"{folder}/{output}", "--frames", f"{folder}/frames"]
            with mock.patch.dict(sys.modules, stubs | reader), mock.patch.object(sys, "argv", arguments), \
                    contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
                try:
                    convert_aedat4.main()
                    code = 0
                except SystemExit as stop:
                    code = stop.code
            times = Path(folder) / "frames" / "timestamps.npz"
            times = dict(np.load(times)) if times.exists() else {}
            self.left = {path.name for path in Path(folder).iterdir()}
        return code, said.getvalue(), pictures, times

    def test_colours_are_in_opencvs_order(self):
        for name, reader in READERS.items():
            with self.subTest(name):
                pictures = self.convert(reader)[2]
                self.assertEqual(pictures["0000.png"][0, 0].tolist(), [BLUE, GREEN, RED])
                self.assertEqual(pictures["0001.png"][1, 3].tolist(), [BLUE, GREEN, RED, OPAQUE])
                self.assertEqual(pictures["0002.png"].shape, (2, 4))

    def test_exposures_run_from_their_start_to_their_end(self):
        for name, reader in READERS.items():
            with self.subTest(name):
                _, said, _, times = self.convert(reader)
                self.assertEqual(times["timestamps_start"].tolist(), [1000000, 2000000, 3000000])
                self.assertEqual(times["timestamps_end"].tolist(), [1010000, 2000249, 3000000])
                self.assertEqual(times["timestamps"].tolist(), [1005000, 2000124, 3000000])
                self.assertIn("1 of 3 frames carry no exposure times", said)

    def test_every_event_arrives_though_the_frames_are_fewer(self):
        for name, reader in READERS.items():
            with self.subTest(name):
                self.assertEqual(self.convert(reader)[0], 0)
                self.assertEqual(Hdf5File.written["t"].tolist(), [1000 * n + i for n in range(BATCHES) for i in range(3)])
                self.assertEqual(Hdf5File.written["p"].tolist(), [0, 1, 0] * BATCHES)

    def test_of_two_cameras_the_first_is_read(self):
        for name, reader in READERS.items():
            with self.subTest(name):
                self.assertIn("left out: 2 (events of DVX)", self.convert(reader)[1])

    def test_a_full_disk_is_told(self):
        code, said, _, times = self.convert(READERS["aedat"], room=1)
        self.assertEqual((code, times), (3, {}))
        self.assertRegex(said, "frames: an image cannot be written; check the free space")

    def test_damage_that_ends_the_interpreter_of_the_package_is_told_before(self):
        description = WHOLE.index(b"<dv")
        for place, bytes_, hint in (
                (0, b"#!AER-DAT3", "found a file that does not begin with"),
                (14, struct.pack("<I", 0xffffffff), "found one of 4294967295"),
                (18, struct.pack("<I", 0xfffffff0), "header that describes the streams"),
                (description - 4, struct.pack("<I", 0x7fffffff), "header that describes the streams"),
                (description + 5, b"\xff", "header that describes the streams"),
                (description, b">", "header that describes the streams"),
                (HEADER_END + 4, struct.pack("<i", -1), f"packet at byte {HEADER_END} does not end"),
                (HEADER_END + 4, struct.pack("<i", 1 << 30), f"packet at byte {HEADER_END} does not end")):
            with self.subTest(hint, place=place, bytes=bytes_):
                damaged = WHOLE[:place] + bytes_ + WHOLE[place + len(bytes_):]
                code, said, _, _ = self.convert(READERS["aedat"], content=damaged)
                self.assertEqual(code, 3)
                self.assertRegex(said, rf"^convert_aedat4: \S+recording.aedat4: .*{hint}.*\n$")
                self.assertEqual(self.left, {"recording.aedat4", "frames"})
        for length in (0, 5, 16, 40, HEADER_END + 3, len(WHOLE) - 1):
            with self.subTest(length=length):
                code, said, _, _ = self.convert(READERS["aedat"], content=WHOLE[:length])
                self.assertEqual(code, 3)
                self.assertRegex(said, r"^convert_aedat4: \S+recording.aedat4: .*\n$")

    def test_a_place_that_cannot_be_written_is_told(self):
        for output in (".", "none/events.h5"):
            code, said, _, _ = self.convert(READERS["aedat"], output=output)
            self.assertEqual(code, 2)
            self.assertRegex(said, r"^convert_aedat4: \S+: expected a file to write in a folder that is there.*\n$")

    def test_without_a_package_nothing_is_left(self):
        code, said, _, _ = self.convert({"aedat": None, "dv_processing": None})
        self.assertEqual(code, 2)
        self.assertRegex(said, r"^convert_aedat4: needs dv-processing or aedat.*\n$")
        self.assertEqual(self.left, {"recording.aedat4", "frames"})

    def test_a_package_that_fails_is_quoted_in_one_line(self):
        failing = module("dv_processing", io=types.SimpleNamespace(MonoCameraRecording=FailingRecording))
        code, said, _, _ = self.convert(failing)
        self.assertEqual(code, 3)
        self.assertRegex(said, r"^convert_aedat4: \S+recording.aedat4: EndOfFile: Error info: it is empty\n$")


if __name__ == "__main__":
    unittest.main()
