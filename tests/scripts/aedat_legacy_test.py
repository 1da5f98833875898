# SPDX-License-Identifier: Apache-2.0
"""Tests of aedat_legacy.py on files written here by the descriptions of AEDAT 3.1 and 2.0 at docs.inivation.com."""
import importlib.util
import struct
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
sys.path.insert(0, str(SCRIPTS))
import aedat_legacy  # noqa: E402

SPECIAL, POLARITY, FRAME, IMU6 = 0, 1, 2, 3
RESET, SIGNAL = 0, 1
WIDTH, HEIGHT = 240, 180


def there(*modules):
    return all(importlib.util.find_spec(module) for module in modules)


class Kept:
    """Stores an Output's data in memory."""

    def __init__(self):
        self.form, self.size, self.stamp, self.edges, self.frames = "", None, "middle", [], []
        self.notes, self.warnings = [], []
        self.columns = [np.zeros(0, np.int64)] * 4

    def events(self, *columns):
        self.columns = [np.concatenate([a, np.asarray(b).astype(np.int64)]) for a, b in zip(self.columns, columns)]

    def frame(self, image, start, end):
        self.frames.append((image, start, end))

    def rows(self):
        return [tuple(int(value) for value in row) for row in zip(*self.columns)]

    def times(self):
        return [frame[1:] for frame in self.frames]


# ---- AEDAT 3.1


def header3(source="DAVIS240C", form="RAW"):
    return (f"#!AER-DAT3.1\r\n#Format: {form}\r\n#Source 1: {source}\r\n#Start-Time: 2017-06-01 10:00:00 (TZ+0200)\r\n"
            "#!END-HEADER\r\n").encode()


def packet3(kind, events, source=1, overflow=0, size=None):
    size = size or max((len(event) for event in events), default=8)
    head = struct.pack("<hhiiiiii", kind, source, size, 4, overflow, len(events), len(events), len(events))
    return head + b"".join(event.ljust(size, b"\0") for event in events)


def polarity3(x, y, t, p, valid=1):
    return struct.pack("<Ii", x << 17 | y << 2 | p << 1 | valid, t)


def special3(kind, t):
    return struct.pack("<Ii", kind << 1 | 1, t)


def frame3(pixels, start, end, valid=1, pattern=0, region=0):
    pixels = np.asarray(pixels, "<u2")
    height, width, channels = pixels.shape
    info = valid | channels << 1 | pattern << 4 | region << 8
    return struct.pack("<Iiiiiiiii", info, start, end, start, end, width, height, 0, 0) + pixels.tobytes()


# ---- AEDAT 2.0


def header2(chip="eu.seebetter.ini.chips.davis.DAVIS240C", is_global=None):
    lines = ["#!AER-DAT2.0", "# This is a raw AE data file - do not edit",
             "# Data format is int32 address, int32 timestamp (8 bytes total), repeated for each event",
             "# Timestamps tick is 1 us", f"# AEChip: {chip}"]
    if is_global is not None:
        lines.append(f'#<entry key="DAVIS240C.APS.GlobalShutter" value="{str(is_global).lower()}"/>')
    return "".join(line + "\r\n" for line in lines).encode()


def record2(address, t):
    return struct.pack(">Ii", address, t)


def polarity2(x, y, t, p):
    """Pixel (x, y) counted from the top left, whereas the file counts from the bottom right."""
    return record2((HEIGHT - 1 - y) << 22 | (WIDTH - 1 - x) << 12 | p << 11, t)


def reads2(kind, values, start, step=1):
    """One read of the active pixels, by columns from the last, each from its last row: [H,W] values of the image."""
    ys, xs = np.mgrid[0:HEIGHT, 0:WIDTH]
    order = np.argsort(-xs.ravel() * HEIGHT + ys.ravel(), kind="stable")
    x, y = xs.ravel()[order], ys.ravel()[order]
    out = np.zeros(x.size, aedat_legacy.RECORD)
    out["word"] = 1 << 31 | (HEIGHT - 1 - y) << 22 | x << 12 | kind << 10 | np.asarray(values).ravel()[order]
    out["t"] = start + np.arange(x.size) // HEIGHT * step
    return out


def picture2():
    ys, xs = np.mgrid[0:HEIGHT, 0:WIDTH]
    return (xs + ys) % 300


def frame2(reset_us, signal_us, step=1):
    reset = np.full((HEIGHT, WIDTH), 800)
    return reads2(RESET, reset, reset_us, step).tobytes() + reads2(SIGNAL, reset - picture2(), signal_us, step).tobytes()


class Reading(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def read(self, content):
        path = self.folder / "a.aedat"
        path.write_bytes(content)
        out = Kept()
        aedat_legacy.read(str(path), out)
        return out

    def refused(self, content, text):
        with self.assertRaisesRegex(ValueError, text) as raised:
            self.read(content)
        self.assertNotIn("\n", str(raised.exception))


class Aedat3(Reading):
    def test_events_frames_and_triggers(self):
        image = np.arange(WIDTH * HEIGHT).reshape(HEIGHT, WIDTH, 1)
        out = self.read(header3() + packet3(POLARITY, [polarity3(3, 4, 1000, 1), polarity3(9, 9, 1001, 1, valid=0),
                                                       polarity3(239, 179, 1002, 0)]) +
                        packet3(IMU6, [bytes(36)]) + packet3(SPECIAL, [special3(3, 1600), special3(2, 1500), special3(4, 1501)]) +
                        packet3(FRAME, [frame3(image, 1100, 5100), frame3(image + 7, 9000, 9000)]))
        self.assertEqual((out.form, out.size), ("AEDAT 3.1", (240, 180)))
        self.assertEqual(out.rows(), [(3, 4, 1000, 1), (239, 179, 1002, 0)])
        self.assertEqual(sorted(out.edges), [(1500, 1), (1600, 0)])
        self.assertEqual(out.times(), [(1100, 5100), (9000, 9000)])
        self.assertEqual(out.frames[0][0].dtype.name, "uint16")
        np.testing.assert_array_equal(out.frames[0][0], image[..., 0])
        np.testing.assert_array_equal(out.frames[1][0], image[..., 0] + 7)
        self.assertEqual(out.warnings, ["1 events or frames are marked invalid and left out"])

    def test_colours_come_as_opencv_has_them(self):
        pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint16)
        pixels[:] = (60000, 20000, 300)
        image = self.read(header3() + packet3(FRAME, [frame3(pixels, 1, 2)])).frames[0][0]
        self.assertEqual(image[5, 6].tolist(), [300, 20000, 60000])

    @unittest.skipUnless(there("cv2"), "needs scripts/setup.sh --import")
    def test_a_mosaic_becomes_colours(self):
        for pattern, (red, blue) in {1: ((0, 0), (1, 1)), 2: ((0, 1), (1, 0)), 3: ((1, 0), (0, 1)), 4: ((1, 1), (0, 0))}.items():
            pixels = np.full((HEIGHT, WIDTH, 1), 20000, np.uint16)
            pixels[red[0]::2, red[1]::2] = 60000
            pixels[blue[0]::2, blue[1]::2] = 300
            image = self.read(header3() + packet3(FRAME, [frame3(pixels, 1, 2, pattern=pattern)])).frames[0][0]
            self.assertEqual(image[8, 8].tolist(), [300, 20000, 60000], pattern)
        self.refused(header3() + packet3(FRAME, [frame3(pixels, 1, 2, pattern=5)]), "white pixels .* convert")

    def test_a_counter_of_31_bits_goes_on(self):
        last = (1 << 31) - 1
        out = self.read(header3() + packet3(POLARITY, [polarity3(1, 1, last, 1)]) +
                        packet3(POLARITY, [polarity3(1, 1, 0, 1)], overflow=1) +
                        packet3(FRAME, [frame3(np.zeros((HEIGHT, WIDTH, 1)), start, 9) for start in (5, last - 9)], overflow=1))
        self.assertEqual(out.columns[2].tolist(), [last, last + 1])
        self.assertEqual(out.times(), [(last + 6, last + 10), (last - 9, last + 10)])

    def test_a_reset_of_the_clock_keeps_the_longest_part(self):
        reset = packet3(SPECIAL, [special3(1, (1 << 31) - 1)])
        out = self.read(header3() + packet3(POLARITY, [polarity3(1, 1, 900000, 1)]) + reset +
                        packet3(POLARITY, [polarity3(2, 2, t, 0) for t in (5, 6, 7)]))
        self.assertEqual(out.columns[2].tolist(), [5, 6, 7])
        self.assertEqual(out.warnings, ["the camera's clock was reset 1 times; only the longest part is read, 75% of all"])

    def test_of_several_cameras_the_one_with_frames_is_read(self):
        out = self.read(header3() + packet3(POLARITY, [polarity3(1, 1, t, 1) for t in range(9)], source=0) +
                        packet3(POLARITY, [polarity3(2, 2, 3, 1)]) + packet3(FRAME, [frame3(np.zeros((HEIGHT, WIDTH, 1)), 1, 2)]))
        self.assertEqual(out.columns[0].tolist(), [2])
        self.assertEqual(out.notes, ["only source 1 is read; left out: 0"])

    def test_what_is_left_out_is_told(self):
        events = packet3(POLARITY, [polarity3(1, 1, 1, 1)])
        out = self.read(header3() + events + packet3(99, [bytes(12)]) + packet3(99, [bytes(12)]))
        self.assertEqual(out.warnings, ["packets of unknown types are left out: 2 of type 99"])
        for cut in (events[:-1], events[:20]):
            out = self.read(header3() + events + cut)
            self.assertEqual(out.columns[2].tolist(), [1])
            self.assertEqual(out.warnings, [f"the file was cut short: its last {len(cut)} bytes are left out"])
        small = frame3(np.zeros((4, 4, 1)), 1, 2)
        whole = frame3(np.zeros((HEIGHT, WIDTH, 1)), 3, 4)
        out = self.read(header3() + packet3(FRAME, [small, whole, frame3(np.zeros((HEIGHT, WIDTH, 1)), 5, 6, region=1)]))
        self.assertEqual(out.times(), [(3, 4)])
        self.assertEqual(out.warnings, ["2 frames show a part of the sensor only and are left out"])

    def test_a_camera_without_a_known_name_has_the_size_of_its_frames(self):
        out = self.read(header3("File") + packet3(FRAME, [frame3(np.zeros((3, 5, 1)), 1, 2)]))
        self.assertEqual(out.size, (5, 3))

    def test_what_is_not_read_is_one_line(self):
        events = packet3(POLARITY, [polarity3(1, 1, 1, 1)])
        self.refused(header3(form="Serial TS") + events, "found Serial TS; convert")
        self.refused(header3().replace(b"3.1", b"3.0") + events, "found #!AER-DAT3.0; convert")
        self.refused(header3(), "found none; record it again")
        self.refused(header3() + packet3(IMU6, [bytes(36)]), "found none; record it again")
        self.refused(header3().replace(b"#!END-HEADER\r\n", b"") + events, "#!END-HEADER, found none; .*copy it again")
        self.refused(header3() + events + packet3(POLARITY, [bytes(12)]), f"at byte {len(header3() + events)}, .*copy it again")
        self.refused(header3() + packet3(-5, [bytes(8)]), "copy it again")
        broken = bytearray(frame3(np.zeros((HEIGHT, WIDTH, 1)), 1, 2))
        broken[20:24] = struct.pack("<i", WIDTH + 1)
        self.refused(header3() + packet3(FRAME, [bytes(broken)]), "found 241x180 of 1 channels; .*copy it again")


class Aedat2(Reading):
    def test_events_and_triggers(self):
        out = self.read(header2() + polarity2(3, 4, 1000, 1) + polarity2(239, 179, 1001, 0) + record2(1 << 10 | 3, 1002) +
                        record2(1 << 10 | 2, 1003) + record2(1 << 31 | 3 << 10 | 77 << 12, 1004))
        self.assertEqual((out.form, out.size), ("AEDAT 2.0", (240, 180)))
        self.assertEqual(out.rows(), [(3, 4, 1000, 1), (239, 179, 1001, 0)])
        self.assertEqual(out.edges, [(1002, 1), (1003, 0)])
        self.assertEqual((out.frames, out.notes), ([], []))

    def test_v2e_names_no_camera_and_its_events_tell_the_sensor(self):
        header = header2().replace(b"# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n", b"")
        with self.assertRaisesRegex(ValueError, "no # AEChip; convert"):
            self.read(header + polarity2(3, 4, 1, 1))
        header = header.replace(b"do not edit", b"created by AEDat2Output in v2e")
        for width, height in ((240, 180), (346, 260)):
            def event(x, y, t, more=0):
                return record2((height - 1 - y) << 22 | (width - 1 - x) << 12 | 1 << 11 | more, t)
            out = self.read(header + event(3, 4, 1000) + event(0, 0, 1001) + event(width - 1, height - 1, 1002, 1 << 10))
            self.assertEqual(out.size, (width, height))
            self.assertEqual(out.rows(), [(3, 4, 1000, 1), (0, 0, 1001, 1), (width - 1, height - 1, 1002, 1)])
            self.assertIn(f"it is that of {width}x{height} px", out.notes[0])
            # A part of a larger sensor would look like the smaller one.
            self.assertEqual("if v2e wrote 346x260 px" in out.notes[0], width == 240)
            self.assertEqual((out.notes[1:], out.edges), (["1 events that v2e labels as noise are kept"], []))
        for other in (479 << 11 | 639 << 1 | 1, 300 << 22 | 300 << 12):  # 640x480 has other bits
            self.refused(header + record2(other, 1), "--dvs_h5 or --dvs_text")

    def test_a_global_shutter_exposes_between_the_two_reads(self):
        out = self.read(header2(is_global=True) + frame2(1000, 9000) + polarity2(1, 1, 9500, 1) + frame2(20000, 28000))
        self.assertEqual(out.times(), [(1239, 9000), (20239, 28000)])
        self.assertEqual(out.frames[0][0].dtype.name, "uint16")
        np.testing.assert_array_equal(out.frames[0][0], picture2() * 64)
        self.assertEqual(out.notes, [])

    def test_a_rolling_shutter_has_the_times_of_its_middle_column(self):
        note = "2 frames have a rolling shutter: their times are those of the middle column, the first and the last differ by 119 us"
        out = self.read(header2(is_global=False) + frame2(1000, 9000) + frame2(20000, 28000))
        self.assertEqual((out.times(), out.notes), ([(1119, 9119), (20119, 28119)], [note]))
        # Overlapping reads reveal a rolling shutter if the header does not contain it.
        reset, signal = reads2(RESET, picture2() + 500, 1000), reads2(SIGNAL, picture2(), 1100)
        both = np.concatenate([reset, signal]).astype(aedat_legacy.RECORD)  # concatenate changes the order of bytes
        frame = both[np.argsort(both["t"], kind="stable")]
        later = frame.copy()
        later["t"] += 5000
        out = self.read(header2() + frame.tobytes() + later.tobytes())
        self.assertEqual((out.times(), out.notes), ([(1119, 1219), (6119, 6219)], [note]))
        self.assertTrue((out.frames[1][0] == 500 * 64).all())

    def test_a_silent_header_leaves_the_length_open(self):
        out = self.read(header2() + frame2(1000, 9000))
        self.assertEqual(out.times(), [((1239 + 9000) // 2,) * 2])
        self.assertIn("length of exposures is not known", out.notes[0])

    def test_frames_that_lack_reads_are_left_out(self):
        frames = [frame2(1000 + k * 20000, 9000 + k * 20000) for k in range(3)]
        out = self.read(header2(is_global=True) + frames[0][8000:] + frames[1] + frames[2][:-8])
        self.assertEqual(out.times(), [(21239, 29000)])
        self.assertEqual(out.warnings, ["2 frames lack reads of pixels and are left out"])
        signals = b"".join(reads2(SIGNAL, picture2(), t).tobytes() for t in range(0, 60000, 10000))
        self.assertEqual(self.read(header2(is_global=True) + signals).frames, [])

    def test_pieces_of_any_size_give_the_same(self):
        content = header2(is_global=True) + frame2(1000, 9000) + polarity2(1, 1, 9500, 1) + frame2(20000, 28000)
        whole = self.read(content)
        kept, aedat_legacy.CHUNK = aedat_legacy.CHUNK, 10007
        self.addCleanup(setattr, aedat_legacy, "CHUNK", kept)
        pieces = self.read(content)
        self.assertEqual((pieces.rows(), pieces.times()), (whole.rows(), whole.times()))
        np.testing.assert_array_equal(pieces.frames[1][0], whole.frames[1][0])

    def test_frames_of_a_colour_sensor_are_not_read(self):
        out = self.read(header2("eu.seebetter.ini.chips.davis.Davis346redColor") + polarity2(1, 1, 1, 1) + record2(1 << 31, 2))
        self.assertEqual((len(out.rows()), len(out.notes)), (1, 1))
        self.assertRegex(out.notes[0], "colour sensor .* convert it to .aedat4")

    def test_a_counter_that_wraps_goes_on(self):
        last = (1 << 32) - 1
        out = self.read(header2() + polarity2(1, 1, 2147483647, 1) + polarity2(1, 1, -2147483648, 1) +
                        polarity2(1, 1, -1, 1) + polarity2(1, 1, 4, 1) + polarity2(1, 1, -1, 1) + polarity2(1, 1, 9, 1))
        self.assertEqual(out.columns[2].tolist(), [2147483647, 2147483648, last, last + 5, last, last + 10])
        self.assertEqual(out.notes, ["the time counter wraps 1 times and is continued"])

    def test_a_reset_of_the_clock_keeps_the_longest_part(self):
        out = self.read(header2() + polarity2(1, 1, 9000000, 1) + b"".join(polarity2(2, 2, t, 0) for t in (5, 6, 7)))
        self.assertEqual(out.columns[2].tolist(), [5, 6, 7])
        self.assertEqual(out.warnings, ["the camera's clock was reset 1 times; only the longest part is read, 75% of all"])

    def test_what_is_left_out_is_told(self):
        out = self.read(header2() + polarity2(1, 1, 1, 1) + polarity2(-1, 1, 2, 1) + b"cut")
        self.assertEqual(out.columns[2].tolist(), [1])
        self.assertEqual(out.warnings, ["the file was cut short: its last 3 bytes are left out",
                                     "1 events lie beside the sensor and are left out"])

    def test_a_first_event_may_look_like_a_line_of_the_header(self):
        first = 0x23 << 24 | 100 << 12
        for more in (b"", b"#End Of ASCII Header\r\n"):
            self.assertEqual(len(self.read(header2() + more + record2(first, 1) + record2(0x0a << 24, 2)).rows()), 2)

    def test_what_is_not_read_is_one_line(self):
        event = polarity2(1, 1, 1, 1)
        self.refused(header2("ch.unizh.ini.jaer.chip.retina.DVS128") + event, "found DVS128; convert")
        self.refused(header2("eu.seebetter.ini.chips.davis.DavisRGBW640") + event, "found DavisRGBW640; convert")
        self.refused(b"#!AER-DAT2.0\r\n" + event, "found no # AEChip; convert")
        self.refused(b"#!AER-DAT1.0\r\n" + event, "found #!AER-DAT1.0; convert")
        self.refused(header2(), "found none; record it again")


@unittest.skipUnless(there("h5py", "cv2"), "needs scripts/setup.sh --import")
class Script(Reading):
    def test_whole_files(self):
        import cv2
        import h5py
        image = np.arange(WIDTH * HEIGHT).reshape(HEIGHT, WIDTH, 1)
        for form, content, expected in (
                ("AEDAT 3.1", header3() + packet3(POLARITY, [polarity3(3, 4, 1000, 1)]) + packet3(FRAME, [frame3(image, 1100, 5100)]),
                 image[..., 0]),
                ("AEDAT 2.0", header2(is_global=True) + polarity2(3, 4, 1000, 1) + frame2(861, 5100), picture2() * 64)):
            with self.subTest(form):
                (self.folder / "a.aedat").write_bytes(content)
                out = self.folder / form
                done = subprocess.run([sys.executable, SCRIPTS / "read_recording.py", self.folder / "a.aedat", out],
                                      capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
                with h5py.File(out / "events.h5") as file:
                    self.assertEqual([file[name][:].tolist() for name in "xytp"], [[3], [4], [1000], [1]])
                self.assertEqual((out / "exposures.csv").read_text(), "name,start_us,end_us\n000000,1100,5100\n")
                self.assertEqual((out / "recording.txt").read_text(),
                                 f"format {form}\nstamp middle\noffset_us 0\nwidth 240\nheight 180\n")
                np.testing.assert_array_equal(cv2.imread(str(out / "images/000000.png"), cv2.IMREAD_UNCHANGED), expected)

    def test_what_is_not_read_is_one_line(self):
        (self.folder / "a.aedat").write_bytes(b"#!AER-DAT3.0\r\n")
        done = subprocess.run([sys.executable, SCRIPTS / "read_recording.py", self.folder / "a.aedat", self.folder / "out"],
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 3)
        self.assertRegex(done.stderr, r"^\S*a.aedat: .*found #!AER-DAT3.0; convert .*\n$")


if __name__ == "__main__":
    unittest.main()
