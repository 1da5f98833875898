# SPDX-License-Identifier: Apache-2.0
"""Tests of read_recording.py, ros_bag.py and recording_folder.py on messages and packets written here by their
specifications. With the packages of scripts/setup.sh --import, also converts whole bags and AEDAT4 files.
"""
import errno
import importlib.util
import os
import struct
import subprocess
import sys
import tempfile
import types
import unittest
from pathlib import Path

import numpy as np

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
sys.path.insert(0, str(SCRIPTS))
import read_recording  # noqa: E402
import recording_folder  # noqa: E402
import ros_bag  # noqa: E402

EVENTS = ((3, 4, 7, 999999999, 1), (345, 259, 8, 1500, 0), (0, 1, 8, 2999, 1))  # x, y, s, ns, polarity
FIELDS = ([3, 345, 0], [4, 259, 1], [7999999, 8000001, 8000002], [1, 0, 1])


def there(*modules):
    return all(importlib.util.find_spec(module) for module in modules)


def ros1_array(events=EVENTS, frame=b"cam"):
    head = struct.pack("<IIII", 5, 7, 0, len(frame)) + frame + struct.pack("<III", 260, 346, len(events))
    return head + b"".join(struct.pack("<HHIIB", *event) for event in events)


def cdr(parts):
    """Serialises numbers with CDR's alignment after its four bytes of encapsulation."""
    out = b""
    for form, value in parts:
        size = struct.calcsize("<" + form)
        out += b"\0" * (-len(out) % size if form != "s" else 0)
        out += value if form == "s" else struct.pack("<" + form, value)
    return b"\0\1\0\0" + out


def ros2_array(frame=b"cam\0"):
    parts = [("i", 7), ("I", 0), ("I", len(frame)), ("s", frame), ("I", 260), ("I", 346), ("I", len(EVENTS))]
    for event in EVENTS:
        parts += list(zip("HHiIB", event))
    return cdr(parts)


def picture(encoding, width, pixels, step=None, big=False, height=1):
    data = np.frombuffer(bytes(pixels), np.uint8)
    return types.SimpleNamespace(encoding=encoding, width=width, height=height, data=data, step=step or len(data) // height,
                                 is_bigendian=big)


class Messages(unittest.TestCase):
    def check(self, raw, ros1):
        size, *fields = ros_bag.event_array(raw, ros1, np)
        self.assertEqual(size, (346, 260))
        for found, expected in zip(fields, FIELDS):
            self.assertEqual(found.tolist(), expected)

    def test_event_arrays_of_both_versions_of_ros(self):
        self.check(ros1_array(), True)
        for frame in (b"cam\0", b"camera\0", b"\0", b"ab\0"):
            with self.subTest(frame):
                self.check(ros2_array(frame), False)

    def test_event_arrays_cut_short(self):
        for raw, ros1 in ((ros1_array()[:-1], True), (ros2_array()[:-1], False)):
            with self.assertRaisesRegex(recording_folder.Problem, "shorter than it says"):
                ros_bag.event_array(raw, ros1, np)

    def test_mono_packets(self):
        words = [1 << 63 | 259 << 48 | 345 << 32 | 1999, 0 << 63 | 2 << 48 | 1 << 32 | 5000]
        for big in (False, True):
            packed = b"".join(struct.pack(">Q" if big else "<Q", word) for word in words)
            message = types.SimpleNamespace(events=np.frombuffer(packed, np.uint8), is_bigendian=big, time_base=10 ** 18)
            x, y, t, p = ros_bag.mono_events(message, np)
            self.assertEqual([x.tolist(), y.tolist(), t.tolist(), p.tolist()],
                             [[345, 1], [259, 2], [10 ** 15 + 1, 10 ** 15 + 5], [1, 0]])

    def test_pictures(self):
        def made(*arguments, **more):
            return ros_bag.to_picture(picture(*arguments, **more), np, None).tolist()
        self.assertEqual(made("mono8", 2, [1, 2, 9], step=3), [[1, 2]])
        self.assertEqual(made("rgb8", 2, [1, 2, 3, 4, 5, 6], height=1), [[[3, 2, 1], [6, 5, 4]]])
        self.assertEqual(made("bgr8", 1, [1, 2, 3]), [[[1, 2, 3]]])
        self.assertEqual(made("mono16", 1, [1, 2], big=True), [[258]])
        self.assertEqual(made("mono16", 1, [1, 2]), [[513]])
        with self.assertRaisesRegex(recording_folder.Problem, "yuv422 are not read"):
            made("yuv422", 1, [1, 2])
        with self.assertRaisesRegex(recording_folder.Problem, "2x1 holds 1 bytes only"):
            made("mono8", 2, [1], step=2)

    def test_the_sensors_clock_undoes_wraps(self):
        def packet(time):
            return struct.pack("<HHHH", 0x2001, 0x8000 | time >> 12, 0x6000 | time & 0xfff, 0x2002)
        clock = ros_bag.SensorClock()
        for stamp, time in ((10 ** 15, (1 << 24) - 10), (10 ** 15 + 30, 20), (10 ** 15 + 130, 120)):
            times, first = ros_bag.sensor_times(packet(time), "evt3", np)
            self.assertEqual((times.tolist(), first), ([time >> 12 << 12], time))
            self.assertEqual(clock.packet(stamp, times, first, 1 << 24), 0)
        self.assertEqual(clock.offset_us(), 10 ** 15 - (1 << 24) + 10)
        self.assertIsNone(ros_bag.sensor_times(b"\x01\x20", "evt3", np)[1])

    def test_times_of_packets_of_evt2_and_evt21(self):
        time, high, event = 0x123456789, 8 << 28 | 0x123456789 >> 6, 1 << 28 | (0x123456789 & 63) << 22 | 7
        for encoding, words in (("evt2", (event, high, event)), ("evt21", (3, event, 0, high, 1, event)),
                                ("evt21", (event, 3, high, 0, event, 1))):
            data = struct.pack(f"<{len(words)}I", *words) + b"cut"
            times, first = ros_bag.sensor_times(data, encoding, np)
            self.assertEqual((times.tolist(), first), ([time >> 6 << 6], time))

    def test_stamps_count_wraps_during_a_pause(self):
        span, second = 1 << 24, 10 ** 6
        for pause, hidden in ((10, 0), (20, 1), (40, 2), (7200, 0)):  # the last one is a fault of the stamps
            with self.subTest(pause):
                clock, time = ros_bag.SensorClock(), 3 * second
                clock.packet(10 ** 15 + time, np.array([time]), time, span)
                time += pause * second
                self.assertEqual(clock.packet(10 ** 15 + time, np.array([time % span]), time % span, span), hidden)
                if hidden:
                    self.assertEqual(clock.ahead, [10 ** 15] * 2)

    def test_a_wrap_within_a_packet_counts(self):
        clock = ros_bag.SensorClock()
        clock.packet(10 ** 15, np.array([(1 << 24) - 4096, 0]), (1 << 24) - 4096, 1 << 24)
        self.assertEqual(clock.packet(10 ** 15 + 8192, np.array([4096]), 4096, 1 << 24), 0)
        self.assertEqual(clock.ahead, [10 ** 15 - (1 << 24) + 4096] * 2)

    def test_damaged_values_are_no_wrap(self):
        high = [100, 101, 102]
        for values, wraps in ((high, 0), ([100, 4000, 101], 0), ([3000, 3001, 16, 3002], 0), ([4095, 0, 1], 1), ([4094, 0, 4095, 0], 1),
                              ([100, 4000, 4001, 102], 0), ([2560, 4095, 256, 2561], 0),
                              ([4090, 2047, 4095, 0, 2047, 4095, 0, 2047, 4091], 2), ([0, 1, 2, 3, 3000, 3001, 3002, 3003, 4000, 1], 1)):
            with self.subTest(values):
                self.assertEqual(ros_bag.wraps_of(values, 4096), wraps)
        clock, whole = ros_bag.SensorClock(), [100, 101, 4000, 102, 103, 4095, 0, 1]
        for start in range(0, len(whole), 3):
            clock.packet(10 ** 6 + start, np.array(whole[start:start + 3]), whole[start], 4096)
        self.assertEqual(clock.wraps, 4096)

    def test_a_pause_is_written_as_time_words(self):
        with tempfile.TemporaryDirectory() as folder:
            reader = ros_bag.BagReader(folder)
            for second, high in ((0, 1), (40, 1 + (40000000 - (2 << 24) >> 12))):
                stamp = types.SimpleNamespace(sec=1000 + second, nanosec=0)
                reader.packet(types.SimpleNamespace(
                    header=types.SimpleNamespace(stamp=stamp), width=4, height=2, encoding="evt3",
                    events=np.array([0x8000 | high, 0x6002], "<u2").view(np.uint8)))
            reader.out.close()
            words = np.frombuffer((Path(folder) / "events.raw").read_bytes().partition(b"% end\n")[2], "<u2").tolist()
            wraps = 2 * [0x87ff, 0x8fff, 0x8000]
            self.assertEqual(words, [0x8001, 0x6002, *wraps, 0x8000 | high, 0x6002, 0x8000 | high, 0x6002])

    def test_the_stamp_places_the_exposure(self):
        for stamp, start in (("start", 5000), ("middle", 4500), ("end", 4000)):
            with self.subTest(stamp), tempfile.TemporaryDirectory() as folder:
                reader = ros_bag.BagReader(folder)
                reader.out.stamp, reader.out.exposures = stamp, [("000000", 5000, 5000)]
                reader.pictures, reader.lengths = [(1, "/dvs")], {"/dvs": [(1, 1000)]}
                reader.give_lengths()
                self.assertEqual(reader.out.exposures, [("000000", start, start + 1000)])

    def test_one_topic_of_each_kind(self):
        topics = [types.SimpleNamespace(topic=topic, msgtype=kind) for topic, kind in (
            ("/b/events", "dvs_msgs/msg/EventArray"), ("/a/events", "dvs_msgs/msg/EventArray"),
            ("/image", "sensor_msgs/msg/Image"), ("/imu", "sensor_msgs/msg/Imu"))]
        self.assertEqual(ros_bag.chosen_topics(topics, "", ""), ["/b/events"])
        self.assertEqual(ros_bag.chosen_topics(topics, "/b/events", ""), ["/a/events"])
        with self.assertRaisesRegex(recording_folder.Problem, "found none called /c; there are /image"):
            ros_bag.chosen_topics(topics, "", "/c")

    def test_frames_come_from_the_camera_of_the_events(self):
        for image, message in (("image_raw", "Image"), ("image_raw/compressed", "CompressedImage")):
            topics = [types.SimpleNamespace(topic=f"/davis/{side}/{name}", msgtype=kind) for side in ("left", "right")
                      for name, kind in (("events", "dvs_msgs/msg/EventArray"), (image, f"sensor_msgs/msg/{message}"))]
            right, left = [[f"/davis/{side}/events", f"/davis/{side}/{image}"] for side in ("right", "left")]
            self.assertEqual(ros_bag.chosen_topics(topics, "", ""), right)
            self.assertEqual(ros_bag.chosen_topics(topics, right[0], ""), left)
            self.assertEqual(ros_bag.chosen_topics(topics, "", right[1]), left)

    def test_frames_of_the_scene_come_before_renderings_and_rectified_frames(self):
        for other, kept in (("/events/rendered", "/flir/image"), ("/flir/dvs_rendering", "/flir/image"), ("/flir/a_rect", "/flir/image"),
                            ("/flir/corrected", "/flir/corrected")):
            topics = [types.SimpleNamespace(topic=topic, msgtype=kind) for topic, kind in (
                ("/events/events", "dvs_msgs/msg/EventArray"), (other, "sensor_msgs/msg/Image"), ("/flir/image", "sensor_msgs/msg/Image"))]
            left = ros_bag.chosen_topics(topics, "", "")
            self.assertEqual({other, "/flir/image"} - set(left), {kept})

    def test_renderings_without_other_frames_are_a_warning(self):
        for topic, count in (("/dvs/dvs_rendering", 1), ("/dvs/image_raw", 0)):
            with tempfile.TemporaryDirectory() as folder:
                reader = ros_bag.BagReader(folder)
                reader.frames_topic = topic
                self.assertEqual(len(reader.finish().warnings), count)

    def test_pictures_come_before_depth(self):
        topics = [types.SimpleNamespace(topic=topic, msgtype=kind) for topic, kind in (
            ("/dvs/events", "dvs_msgs/msg/EventArray"), ("/dvs/a", "sensor_msgs/msg/Image"), ("/dvs/b", "sensor_msgs/msg/Image"),
            ("/other/c", "sensor_msgs/msg/Image"))]
        for encodings, kept in ((("mono16", "rgb8", "mono8"), "/dvs/b"), (("16UC1", "32FC1", "bgr8"), "/other/c"),
                                (("mono16", "16UC1", "32FC1"), "/dvs/a"), (("bgr16", "mono8", "mono8"), "/dvs/b")):
            with self.subTest(encodings):
                forms = dict(zip(("/dvs/a", "/dvs/b", "/other/c"), encodings))
                self.assertEqual({"/dvs/a", "/dvs/b", "/other/c"} - set(ros_bag.chosen_topics(topics, "", "", forms)), {kept})
        self.assertNotIn("/dvs/a", ros_bag.chosen_topics(topics, "", "/dvs/a", forms))

    def test_a_bag_without_its_index_names_the_remedy(self):
        for name, remedy in (("a.bag", "rosbag reindex a.bag"), ("b/a.db3", "ros2 bag reindex b"), ("a.mcap", "mcap recover a.mcap")):
            self.assertIn(remedy, ros_bag.index_remedy(name))

    def test_camera_info_of_both_versions_of_ros(self):
        matrix = np.array([199.0, 0, 120, 0, 198, 90, 0, 0, 1])
        for names in ("KD", "kd"):
            values = dict(zip(names, (matrix, np.array([-0.3, 0.1, 0, 0, 0]))))
            message = types.SimpleNamespace(width=240, height=180, distortion_model="plumb_bob", **values)
            text = ros_bag.camera_info_text(message)
            self.assertIn("image_width: 240\nimage_height: 180\ncamera_matrix:\n", text)
            self.assertIn("  data: [199.0, 0.0, 120.0, 0.0, 198.0, 90.0, 0.0, 0.0, 1.0]\ndistortion_model: plumb_bob\n", text)
            self.assertIn("  data: [-0.3, 0.1, 0.0, 0.0, 0.0]\n", text)
            self.assertNotIn("binning", text)
            message.binning_x = message.binning_y = 2
            self.assertIn("\nbinning_x: 2\nbinning_y: 2\n", ros_bag.camera_info_text(message))
            message.roi = types.SimpleNamespace(x_offset=0, y_offset=0, width=240, height=180)
            self.assertNotIn("roi", ros_bag.camera_info_text(message))
            message.roi.x_offset = 20
            self.assertIn("\nroi:\n  x_offset: 20\n  y_offset: 0\n  width: 240\n  height: 180\ncamera_matrix:\n",
                          ros_bag.camera_info_text(message))
            setattr(message, names[0], np.zeros(9))
            self.assertIsNone(ros_bag.camera_info_text(message))

    def calibration(self, frames, events, **changes):
        """The camera_info.yaml and the warnings of a bag with these topics."""
        turn = np.array([0.0, -1, 0, 1, 0, 0, 0, 0, 1])  # by 90 degrees
        message = types.SimpleNamespace(width=240, height=180, distortion_model="plumb_bob", binning_x=0, binning_y=0, R=turn,
                                        K=np.array([199.0, 0, 120, 0, 198, 90, 0, 0, 1]), D=np.array([-0.3, 0.1, 0, 0, 0]),
                                        P=np.array([150.0, 0, 121, -7, 0, 151, 91, 0, 0, 0, 1, 0]))
        vars(message).update(changes)
        with tempfile.TemporaryDirectory() as folder:
            reader = ros_bag.BagReader(folder)
            reader.infos = {ros_bag.room_of(frames): message}
            reader.rooms = {"frames": ros_bag.room_of(frames), "events": ros_bag.room_of(events)}
            reader.frames_topic = frames
            reader.give_calibration()
            path = Path(folder) / "camera_info.yaml"
            return path.read_text() if path.exists() else "", reader.out.warnings

    def test_rectified_frames_have_the_matrix_p(self):
        text, warnings = self.calibration("/cam/image_rect", "/dvs/events")
        self.assertIn("  data: [150.0, 0.0, 121.0, 0.0, 151.0, 91.0, 0.0, 0.0, 1.0]\n", text)
        self.assertIn("  data: []\n", text)
        self.assertEqual(warnings, [])

    def test_rectified_frames_and_raw_events_are_two_views(self):
        text, warnings = self.calibration("/dvs/image_rect_color/compressed", "/dvs/events")
        self.assertRegex(text, r"(?s)^cam0:.*  intrinsics: \[150.0, 151.0, 121.0, 91.0\]\n.*  distortion_model: none\ncam1:")
        self.assertRegex(text, r"(?s)cam1:.*  intrinsics: \[199.0, 198.0, 120.0, 90.0\]\n.*  distortion_coeffs: \[-0.3, 0.1, 0.0, 0.0\]\n"
                               r"  T_cn_cnm1: \[\[0.0, 1.0, 0.0, 0.0\], \[-1.0, 0.0, 0.0, 0.0\], ")
        self.assertRegex(warnings[0], "found /dvs/image_rect_color/compressed, which is rectified .* --plane-depth 1 ")
        text, warnings = self.calibration("/dvs/image_rect", "/dvs/events", D=np.array([-0.3, 0.1, 0, 0, 0.2]))
        self.assertEqual(text, "")
        self.assertRegex(warnings[0], "camera_info cannot be used: .* --calibration of both")

    def test_raw_frames_and_those_without_distortion_are_one_view(self):
        for frames, changes in (("/dvs/image_raw", {}), ("/dvs/image_rect", {"D": (), "P": (199, 0, 120, 0, 0, 198, 90, 0, 0, 0, 1, 0)})):
            text, warnings = self.calibration(frames, "/dvs/events", **changes)
            self.assertIn("  data: [199.0, 0.0, 120.0, 0.0, 198.0, 90.0, 0.0, 0.0, 1.0]\n", text)
            self.assertEqual(warnings, [])

    def test_one_stream_of_each_kind(self):
        streams = {number: {"type": kind, "source": camera} for number, kind, camera in (
            (4, "events", "A"), (0, None, "A"), (1, "events", "B"), (2, "frame", "A"), (3, "triggers", "B"))}
        chosen, problem = read_recording.chosen_streams, read_recording.NoSuchStream
        self.assertEqual(chosen(streams), {"events": 4, "frame": 2, "triggers": 3})
        for wanted in ("1", "B"):
            self.assertEqual(chosen(streams, wanted), {"events": 1, "frame": 2, "triggers": 3})
        self.assertEqual(chosen(streams, "", "A"), {"events": 4, "frame": 2, "triggers": 3})
        with self.assertRaisesRegex(problem, r"of events, found 2; there are 1 \(B\), 4 \(A\)$"):
            chosen(streams, "2")
        self.assertEqual(list(read_recording.stream_notes(streams, chosen(streams, "1"))), [
            "only one stream of each kind is read; left out: 4 (events of A)", "events are of B, frames of A"])
        unnamed = {number: {"type": kind, "source": ""} for number, kind in ((0, "events"), (1, "events"), (2, "frame"))}
        self.assertEqual(chosen(unnamed), {"events": 0, "frame": 2})
        self.assertEqual(chosen({}), {})

    def test_a_full_disk_is_named(self):
        full = OSError("Can't write data (file write failed: errno = 28, error message = 'No space left on device')")
        for error in (OSError(errno.ENOSPC, "x"), OSError(errno.EDQUOT, "x"), full):
            with self.assertRaisesRegex(recording_folder.Problem, "^no space in out; .*set TMPDIR"):
                recording_folder.check_space(error, "out")
        for error in (OSError(errno.EIO, "x"), ValueError("cut short")):
            self.assertIsNone(recording_folder.check_space(error, "out"))

    def test_missing_packages_are_one_line(self):
        done = subprocess.run([sys.executable, "-S", SCRIPTS / "read_recording.py", __file__, "out"], capture_output=True, text=True)
        self.assertEqual(done.returncode, recording_folder.PACKAGE_MISSING)
        self.assertRegex(done.stderr, r"^needs the Python package numpy: run scripts/setup.sh --import, or pip install 'jade-gs\[import\]'\n$")


def rows(path):
    return [tuple(line.split(",")) for line in path.read_text().splitlines()[1:]]


@unittest.skipUnless(there("rosbags", "h5py", "cv2"), "needs scripts/setup.sh --import")
class Bags(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def convert(self, path, *options):
        out = self.folder / f"out_of_{path.name}"
        done = subprocess.run([sys.executable, SCRIPTS / "read_recording.py", path, out, *options], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return out

    def test_a_davis_recording_of_ros1(self):
        from rosbags.rosbag1 import Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        store = get_typestore(Stores.ROS1_NOETIC)
        event = "uint16 x\nuint16 y\ntime ts\nbool polarity\n"
        store.register(get_types_from_msg(event, "dvs_msgs/msg/Event"))
        store.register(get_types_from_msg("Header header\nuint32 height\nuint32 width\nEvent[] events\n", "dvs_msgs/msg/EventArray"))
        types_ = store.types
        stamp = types_["builtin_interfaces/msg/Time"](sec=7, nanosec=500000000)
        header = types_["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="")
        image = types_["sensor_msgs/msg/Image"](header=header, height=1, width=2, encoding="mono8", is_bigendian=0, step=2,
                                                data=np.array([5, 200], np.uint8))
        made = [types_["dvs_msgs/msg/Event"](x, y, types_["builtin_interfaces/msg/Time"](s, ns), bool(p)) for x, y, s, ns, p in EVENTS]
        array = types_["dvs_msgs/msg/EventArray"](header=header, height=260, width=346, events=made)
        length = types_["std_msgs/msg/Int32"]
        region = types_["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        camera = types_["sensor_msgs/msg/CameraInfo"](
            header=header, height=260, width=346, distortion_model="plumb_bob", D=np.array([0.1, 0, 0, 0, 0]),
            K=np.array([250.0, 0, 170, 0, 251, 130, 0, 0, 1]), R=np.zeros(9), P=np.zeros(12), binning_x=0, binning_y=0, roi=region)
        # Frames at 10, 50 and 90; the driver publishes each exposure time after its frame, but the two may arrive in
        # reverse order. The other camera's times are not used.
        messages = ((1, "/dvs/events", array), (2, "/dvs/camera_info", camera), (10, "/dvs/image_raw", image), (11, "/dvs/exposure", length(data=4000)),
                    (49, "/dvs/exposure", length(data=6000)), (50, "/dvs/image_raw", image), (50, "/right/exposure", length(data=2)),
                    (90, "/dvs/image_raw", image), (91, "/dvs/exposure", length(data=8000)))
        with Writer(self.folder / "a.bag") as bag:
            connections = {}
            for at, topic, message in messages:
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, kind, typestore=store)
                bag.write(connections[topic], at, store.serialize_ros1(message, kind))
        out = self.convert(self.folder / "a.bag")
        import h5py
        with h5py.File(out / "events.h5") as file:
            self.assertEqual([file[name][:].tolist() for name in "xytp"], [list(field) for field in FIELDS])
        self.assertEqual(rows(out / "exposures.csv"), [("000000", "7498000", "7502000"), ("000001", "7497000", "7503000"),
                                                       ("000002", "7496000", "7504000")])
        self.assertIn("width 346", (out / "recording.txt").read_text())
        self.assertIn("  data: [250.0, 0.0, 170.0, 0.0, 251.0, 130.0, 0.0, 0.0, 1.0]\n", (out / "camera_info.yaml").read_text())
        self.convert(self.folder / "a.bag", "--stamp", "end")
        self.assertEqual(rows(out / "exposures.csv")[0], ("000000", "7496000", "7500000"))
        self.assertIn("stamp end\n", (out / "recording.txt").read_text())
        # Another recording into the same folder: the first one's files are removed, others stay.
        (out / "images" / "mine.png").touch()
        (out / "triggers.csv").touch()
        with Writer(self.folder / "b.bag") as bag:
            bag.write(bag.add_connection("/dvs/image_raw", image.__msgtype__, typestore=store), 1,
                      store.serialize_ros1(image, image.__msgtype__))
        done = subprocess.run([sys.executable, SCRIPTS / "read_recording.py", self.folder / "b.bag", out], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(sorted(str(path.relative_to(out)) for path in out.rglob("*.*")),
                         ["exposures.csv", "images/000000.png", "images/mine.png", "recording.txt"])

    def test_packets_and_pictures_of_ros2(self):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        store = get_typestore(Stores.ROS2_HUMBLE)
        kind = "event_camera_msgs/msg/EventPacket"
        store.register(get_types_from_msg(ros_bag.PACKET, kind))
        types_ = store.types
        header = types_["std_msgs/msg/Header"](stamp=types_["builtin_interfaces/msg/Time"](sec=7, nanosec=0), frame_id="a")
        words = np.frombuffer(struct.pack("<HHHH", 0x8001, 0x6002, 0x0003, 0x2805), np.uint8)
        packet = types_[kind](header=header, height=720, width=1280, seq=0, time_base=0, encoding="evt3", is_bigendian=False,
                              events=words)
        image = types_["sensor_msgs/msg/Image"](header=header, height=1, width=2, encoding="rgb8", is_bigendian=0, step=6,
                                                data=np.array([1, 2, 3, 4, 5, 6], np.uint8))
        import cv2
        for storage in (StoragePlugin.SQLITE3, StoragePlugin.MCAP):
            with Writer(self.folder / storage.name, version=9, storage_plugin=storage) as bag:
                for topic, name, message in (("/events", kind, packet), ("/image", "sensor_msgs/msg/Image", image)):
                    connection = bag.add_connection(topic, name, typestore=store)
                    bag.write(connection, 1, store.serialize_cdr(message, name))
            file = next(path for path in (self.folder / storage.name).iterdir() if path.suffix != ".yaml")
            for path in (self.folder / storage.name, file):
                with self.subTest(path.name):
                    out = self.convert(path)
                    self.assertEqual((out / "events.raw").read_bytes(), b"% evt 3.0\n% geometry 1280x720\n% end\n" + words.tobytes())
                    self.assertEqual(rows(out / "exposures.csv"), [("000000", "7000000", "7000000")])
                    self.assertIn("stamp start\noffset_us 6995902\n", (out / "recording.txt").read_text())
                    self.assertEqual(cv2.imread(str(out / "images/000000.png")).tolist(), [[[3, 2, 1], [6, 5, 4]]])

    def test_files_that_are_no_bag(self):
        for name, content in (("a.bag", b"#ROSBAG V2.0\ncut"), ("b.db3", b"SQLite format 3\0cut")):
            (self.folder / name).write_bytes(content)
            done = subprocess.run([sys.executable, SCRIPTS / "read_recording.py", self.folder / name, self.folder / "out"],
                                  capture_output=True, text=True)
            self.assertEqual(done.returncode, recording_folder.DATA_ERROR)
            self.assertRegex(done.stderr, rf"^\S*{name}: cannot be read as a ROS bag: .*\n$")


def table(at, fields):
    """A table of FlatBuffers with its vtable at `at`, and the position of the table. Numbers are (form, value),
    lists ("list", (length, bytes)), lists of tables ("tables", [fields, ...]).
    """
    count = len(fields)
    place = at + 4 + 2 * count
    place += (4 - place) % 8  # so that the fields, 8 bytes apart, are aligned
    head = struct.pack("<HH", 4 + 2 * count, 4 + 8 * count) + struct.pack(f"<{count}H", *(4 + 8 * i for i in range(count)))
    inline, behind = struct.pack("<i", place - at), b""
    end = place + 4 + 8 * count
    for i, (form, value) in enumerate(fields):
        if form in ("list", "tables"):
            behind += b"\0" * ((4 - end - len(behind)) % 8)
            start = end + len(behind)
            behind += packed_list(value) if form == "list" else list_of_tables(start, value)
            form, value = "I", start - (place + 4 + 8 * i)
        inline += struct.pack("<" + form, value).ljust(8, b"\0")
    return head.ljust(place - at, b"\0") + inline + behind, place


def packed_list(value):
    return struct.pack("<I", value[0]) + value[1]


def list_of_tables(start, tables):
    offsets, behind = b"", b""
    for i, fields in enumerate(tables):
        behind += b"\0" * (-(start + 4 + 4 * len(tables) + len(behind)) % 8)
        made, place = table(start + 4 + 4 * len(tables) + len(behind), fields)
        offsets += struct.pack("<I", place - (start + 4 + 4 * i))
        behind += made
    return struct.pack("<I", len(tables)) + offsets + behind


def flatbuffer(kind, fields):
    """With its size as a prefix, as in AEDAT4."""
    made, place = table(12, fields)
    content = struct.pack("<I", place - 4) + kind + made
    return struct.pack("<I", len(content)) + content


def aedat4(streams, packets):
    """A file without compression. streams: (kind, width, height, camera or nothing); packets: (number of the stream,
    fields).
    """
    nodes = "".join(f'<node name="{i}"><attr key="typeIdentifier" type="string">{kind}</attr><node name="info">'
                    f'<attr key="sizeX" type="int">{width}</attr><attr key="sizeY" type="int">{height}</attr>'
                    + "".join(f'<attr key="source" type="string">{name}</attr>' for name in camera) + "</node></node>"
                    for i, (kind, width, height, *camera) in enumerate(streams))
    described = f'<dv version="2.0"><node name="outInfo">{nodes}</node></dv>'.encode()
    out = b"#!AER-DAT4.0\r\n" + flatbuffer(b"IOHE", [("i", 0), ("q", -1), ("list", (len(described), described + b"\0"))])
    for number, fields in packets:
        content = flatbuffer(streams[number][0].encode(), fields)
        out += struct.pack("<ii", number, len(content)) + content
    return out


def aedat4_frame(t, start, end, form, width, height, pixels):
    return [("q", t), ("q", t), ("q", t), ("q", start), ("q", end), ("b", form), ("h", width), ("h", height), ("h", 0), ("h", 0),
            ("list", (len(pixels), bytes(pixels)))]


@unittest.skipUnless(there("aedat", "h5py", "cv2"), "needs scripts/setup.sh --import")
class Aedat4(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def run_on(self, content, *options):
        path = self.folder / "a.aedat4"
        path.write_bytes(content)
        return subprocess.run([sys.executable, SCRIPTS / "read_recording.py", path, self.folder / "out", *options],
                              capture_output=True, text=True)

    def test_events_frames_and_triggers(self):
        event_lists = (((1000, 3, 4, 1), (1001, 345, 259, 0)), ((1002, 0, 1, 1),))
        packets = [(0, [("list", (len(events), b"".join(struct.pack("<qhhB3x", *event) for event in events)))])
                   for events in event_lists]
        gray, bgr = 0, 16
        packets.insert(1, (1, aedat4_frame(1500, 1100, 1900, bgr, 2, 1, [1, 2, 3, 4, 5, 6])))
        packets.append((1, aedat4_frame(2500, 0, 0, gray, 1, 2, [7, 200])))
        rising, falling, frame_begin = 1, 2, 6
        packets.append((2, [("tables", [[("q", 1300), ("b", falling)], [("q", 1100), ("b", frame_begin)], [("q", 1200), ("b", rising)]])]))
        done = self.run_on(aedat4([("EVTS", 346, 260), ("FRME", 346, 260), ("TRIG", 0, 0)], packets))
        self.assertEqual(done.returncode, 0, done.stderr)
        out = self.folder / "out"
        import cv2
        import h5py
        with h5py.File(out / "events.h5") as file:
            self.assertEqual([file[name][:].tolist() for name in "xytp"],
                             [[3, 345, 0], [4, 259, 1], [1000, 1001, 1002], [1, 0, 1]])
        self.assertEqual(rows(out / "exposures.csv"), [("000000", "1100", "1900"), ("000001", "2500", "2500")])
        self.assertEqual(rows(out / "triggers.csv"), [("1200", "1"), ("1300", "0")])
        self.assertEqual((out / "recording.txt").read_text(), "format AEDAT4\nstamp middle\noffset_us 0\nwidth 346\nheight 260\n")
        self.assertEqual(cv2.imread(str(out / "images/000000.png")).tolist(), [[[1, 2, 3], [4, 5, 6]]])
        self.assertEqual(cv2.imread(str(out / "images/000001.png"), cv2.IMREAD_UNCHANGED).tolist(), [[7], [200]])

    def test_events_and_frames_come_from_one_camera(self):
        packets = [(number, [("list", (1, struct.pack("<qhhB3x", 1000, x, 4, 1)))]) for number, x in ((0, 3), (1, 5))]
        packets.append((2, aedat4_frame(1500, 1100, 1900, 0, 1, 2, [7, 7])))
        content = aedat4([("EVTS", 346, 260, "DVX"), ("EVTS", 346, 260, "DAVIS"), ("FRME", 346, 260, "DAVIS")], packets)
        import h5py
        for options, x, note in (((), 5, "0 (events of DVX)"), (("--events-topic", "DVX"), 3, "1 (events of DAVIS)"),
                                 (("--events-topic", "0"), 3, "1 (events of DAVIS)")):
            with self.subTest(options):
                done = self.run_on(content, *options)
                self.assertEqual(done.returncode, 0, done.stderr)
                with h5py.File(self.folder / "out" / "events.h5") as file:
                    self.assertEqual(file["x"][:].tolist(), [x])
                self.assertIn(f"left out: {note}\n", (self.folder / "out" / "recording.txt").read_text())
        done = self.run_on(content, "--events-topic", "2")
        self.assertEqual(done.returncode, recording_folder.DATA_ERROR)
        self.assertRegex(done.stderr, r"a.aedat4: expected the number or camera .*, found 2; there are 0 \(DVX\), 1 \(DAVIS\)\n$")

    def test_of_two_unnamed_cameras_the_first_is_read(self):
        packets = [(number, [("list", (1, struct.pack("<qhhB3x", *event)))])
                   for number, event in ((1, (1000, 600, 400, 1)), (0, (1001, 3, 4, 1)), (1, (1002, 600, 401, 1)))]
        packets += [(number, aedat4_frame(1500, 1100, 1900, 0, 1, 2, [value, value])) for number, value in ((2, 7), (3, 200))]
        done = self.run_on(aedat4([("EVTS", 346, 260), ("EVTS", 640, 480), ("FRME", 346, 260), ("FRME", 640, 480)], packets))
        self.assertEqual(done.returncode, 0, done.stderr)
        out = self.folder / "out"
        import h5py
        with h5py.File(out / "events.h5") as file:
            self.assertEqual(file["x"][:].tolist(), [3])
        self.assertEqual(rows(out / "exposures.csv"), [("000000", "1100", "1900")])
        self.assertIn("width 346\nheight 260\nnote only one stream of each kind is read; left out: 1 (events), 3 (frame)\n",
                      (out / "recording.txt").read_text())

    @unittest.skipUnless(os.path.exists("/dev/full"), "needs /dev/full")
    def test_a_full_disk(self):
        (self.folder / "out").mkdir()
        (self.folder / "out/recording.txt").symlink_to("/dev/full")
        done = self.run_on(aedat4([("EVTS", 346, 260)], [(0, [("list", (1, struct.pack("<qhhB3x", 1000, 3, 4, 1)))])]))
        self.assertEqual(done.returncode, recording_folder.DATA_ERROR)
        self.assertRegex(done.stderr, r"^no space in \S*out; .*set TMPDIR.*\n$")

    def test_a_damaged_file_is_told_in_one_line(self):
        whole = aedat4([("EVTS", 346, 260)], [(0, [("list", (1, struct.pack("<qhhB3x", 1000, 3, 4, 1)))])])
        packets, name = 18 + struct.unpack_from("<I", whole, 14)[0], whole.index(b"</node>") + 3
        # Each ends the package's interpreter, or raises an error that no Python code catches.
        for content in (whole[:18] + b"\xf0\xff\xff\xff" + whole[22:],  # the table of the header
                        whole[:name] + b"\xec" + whole[name + 1:],  # its description
                        whole[:packets] + struct.pack("<iii", 0, 4, 0)):  # a packet without room for its table
            with self.subTest(bytes=len(content)):
                done = self.run_on(content)
                self.assertEqual(done.returncode, recording_folder.DATA_ERROR)
                self.assertRegex(done.stderr, r"^\S*a.aedat4: .*; the file is damaged or was cut short, copy it again\n$")

    def test_a_file_cut_short(self):
        done = self.run_on(b"#!AER-DAT4.0\r\n\x10\0\0\0cut")
        self.assertEqual(done.returncode, recording_folder.DATA_ERROR)
        self.assertRegex(done.stderr, r"^\S*a.aedat4: .*cut short, copy it again\n$")


if __name__ == "__main__":
    unittest.main()
