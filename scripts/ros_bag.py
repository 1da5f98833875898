# SPDX-License-Identifier: Apache-2.0
"""Reads ROS 1 and ROS 2 bags (package rosbags) for read_recording.py, with dvs_msgs or prophesee_event_msgs EventArray,
event_camera_msgs EventPacket (evt3, evt21, evt2, mono), sensor_msgs Image and CompressedImage, CameraInfo, and the
exposure topic of rpg_dvs_ros (std_msgs/Int32).
"""
import bisect
import itertools
import re
import statistics
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from recording_folder import Output, Problem, check_space, need  # noqa: E402

TRANSPORTS = ("compressed", "compressedDepth", "ffmpeg", "theora", "zstd")
RECTIFIED = re.compile(r"[/_]rect(ified)?(_|/|$)")
# Larger steps of the packets' stamps are faults.
LONGEST_PAUSE_US = 3600 * 1000000

PACKET = """std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
"""


def stamp_us(header):
    """Time stamp of a message, in microseconds."""
    return header.stamp.sec * 1000000 + header.stamp.nanosec // 1000


def room_of(topic):
    """The namespace of a camera, without the transport of an image: /cam of /cam/image_raw/compressed."""
    name, _, transport = topic.rpartition("/")
    return name.rpartition("/")[0] if transport in TRANSPORTS else name


def event_array(raw, ros1, np):
    """The size and the fields of a serialised EventArray of dvs_msgs or prophesee_event_msgs. Parsed from the bytes:
    one Python object per event would be a thousand times slower.
    """
    data = np.frombuffer(raw, dtype=np.uint8)
    word = lambda at: int.from_bytes(bytes(data[at:at + 4]), "little")  # noqa: E731
    at = 12  # seq and stamp; in ROS 2 the encapsulation and the stamp
    at += 4 + word(at)  # frame_id
    if not ros1:
        at += -at % 4
    height, width, count = word(at), word(at + 4), word(at + 8)
    at += 12
    if ros1:
        record = np.dtype([("x", "<u2"), ("y", "<u2"), ("s", "<u4"), ("ns", "<u4"), ("p", "u1")])
        if at + 13 * count > len(data):
            raise Problem("an event message is shorter than it says")
        events = np.frombuffer(raw, dtype=record, count=count, offset=at)
        x, y, s, ns, p = (events[name] for name in ("x", "y", "s", "ns", "p"))
    else:
        # CDR aligns: the 4-byte numbers are at 4 and 8 of each 16 bytes, x and y of all but the first event directly
        # after the previous polarity.
        if count and at + 16 * (count - 1) + 13 > len(data):
            raise Problem("an event message is shorter than it says")
        i = np.arange(count) * 16 + at
        first = np.where(np.arange(count) == 0, i, i - 2)

        def whole(start, size):
            return sum(data[start + k].astype(np.int64) << (8 * k) for k in range(size))
        x, y = whole(first, 2), whole(first + 2, 2)
        s, ns, p = whole(i + 4, 4), whole(i + 8, 4), data[i + 12]
    return (width, height), x, y, s.astype(np.int64) * 1000000 + ns.astype(np.int64) // 1000, p


def mono_events(message, np):
    """Decodes an EventPacket of encoding mono: 64 bits per event, from the top: polarity, 15 bits y, 16 bits x, 32
    bits of ns since time_base.
    """
    words = np.frombuffer(message.events.tobytes(), dtype=">u8" if message.is_bigendian else "<u8").astype(np.uint64)
    t = message.time_base + (words & np.uint64(0xffffffff)).astype(np.int64)
    return ((words >> np.uint64(32)) & np.uint64(0xffff), (words >> np.uint64(48)) & np.uint64(0x7fff), t // 1000,
            words >> np.uint64(63))


def sensor_times(data, encoding, np):
    """The time words of a packet, us, and the first full time, all modulo the range of the sensor's counter."""
    if encoding == "evt3":
        words = np.frombuffer(data[:len(data) // 2 * 2], dtype="<u2")
        kinds, times, parts = words >> 12, words & 0xfff, words & 0xfff
        bits, finer = 12, kinds == 6
    else:
        words = np.frombuffer(data[:len(data) // 8 * 8 if encoding == "evt21" else len(data) // 4 * 4], dtype="<u4")
        if encoding == "evt21":  # either half may come first; that of a time is empty behind its type
            halves = words.reshape(-1, 2)
            words = max((halves[:, k] for k in (0, 1)),
                        key=lambda half: ((half >> 28 == 8) & (halves.sum(axis=1, dtype=np.uint64) == half)).sum())
        kinds, times, parts = words >> 28, words & 0xfffffff, words >> 22 & 63
        bits, finer = 6, (kinds < 2) | (kinds == 10)
    high = np.flatnonzero(kinds == 8)
    if not len(high):
        return (), None
    low = np.flatnonzero(finer[high[0]:])
    times = times[high].astype(np.int64) << bits
    return times, int(times[0]) + (int(parts[high[0]:][low[0]]) if len(low) else 0)


MOST_DAMAGED = 4  # values in a row


def wraps_of(times, span):
    """Wraps in successive values of a counter of `span` us, as EvtDecoder (recording/evt.h) counts them: a decrease by
    more than half of the span, unless values are damaged: then a later one is near that before them.
    """
    past = []  # the last values and the wraps before each, the latest first
    for time, _ in itertools.groupby(times):
        fell = bool(past) and past[0][0] - time > span // 2
        wraps = past[0][1] + fell if past else 0
        damaged = damaged_before(past, time, span)
        if damaged:
            wraps = past[damaged][1]
        past = [(time, wraps), *past[:MOST_DAMAGED]]
    return past[0][1] if past else 0


def damaged_before(past, time, span):
    """Number of damaged values before this one, which lies shortly after a value before them; several include no plausible wrap
    unless another step is too long.
    """
    following, wrapped, leapt = time, False, False
    for count, (value, _) in enumerate(past):
        wrapped |= value - following > span // 2 and following + span - value <= span // 16
        leapt |= following - value > span // 2
        if count > 1 and wrapped and not leapt:
            break
        if 0 <= time - value <= span // 16:
            return count
        following = value
    return 0


class SensorClock:
    """Offset of the stamps of packets from the sensor's counter, which it unwraps."""

    def __init__(self):
        self.wraps, self.stamp, self.ahead = 0, None, []
        self.last = []  # the counter's last values

    def packet(self, stamp, times, first, span):
        """Returns the number of wraps of the counter, of `span` us, before this packet if it was silent for so long
        that its words show fewer; else 0.
        """
        if first is None:
            return 0
        known, seen = len(self.last), self.last + times.tolist()
        before, begun, ended = (wraps_of(seen[:count], span) for count in (known, known + 1, len(seen)))
        wraps = self.wraps + span * (begun - before)
        hidden = 0
        if self.ahead and 0 < stamp - self.stamp < LONGEST_PAUSE_US:
            said = round((stamp - self.ahead[-1] - first) / span) * span
            if said > wraps:
                wraps, hidden = said, (said - self.wraps) // span
        self.ahead.append(stamp - wraps - first)
        self.wraps = wraps + span * (ended - begun)
        self.stamp, self.last = stamp, [time for time, _ in itertools.groupby(seen)][-MOST_DAMAGED - 1:]
        return hidden

    def offset_us(self):
        return round(statistics.median(self.ahead)) if self.ahead else 0


def to_picture(message, np, cv2):
    """Converts a sensor_msgs Image for OpenCV."""
    form = message.encoding
    kinds = {"mono8": (1, 1), "8UC1": (1, 1), "mono16": (2, 1), "16UC1": (2, 1), "rgb8": (1, 3), "bgr8": (1, 3), "8UC3": (1, 3),
             "rgba8": (1, 4), "bgra8": (1, 4), "rgb16": (2, 3), "bgr16": (2, 3)}
    kinds.update({f"bayer_{order}{bits}": (bits // 8, 1) for order in ("rggb", "bggr", "gbrg", "grbg") for bits in (8, 16)})
    if form not in kinds:
        raise Problem(f"images of encoding {form} are not read; expected one of {', '.join(kinds)}")
    size, channels = kinds[form]
    rows = np.frombuffer(message.data.tobytes(), dtype=np.uint8)
    if message.step < message.width * size * channels or len(rows) < message.step * message.height:
        raise Problem(f"an image of {message.width}x{message.height} holds {len(rows)} bytes only")
    rows = rows[:message.step * message.height].reshape(message.height, message.step)[:, :message.width * size * channels]
    order = ">" if message.is_bigendian else "<"
    image = np.ascontiguousarray(rows).view(f"{order}u{size}").astype(f"u{size}")
    image = image.reshape(message.height, message.width, channels)
    if channels == 1:
        image = image[..., 0]
    if form.startswith("rgb"):
        return np.ascontiguousarray(image[..., [2, 1, 0]])
    if form.startswith("bayer"):
        # OpenCV names a pattern after its second row and second column.
        code = {"rggb": "BG", "bggr": "RG", "gbrg": "GR", "grbg": "GB"}[form[6:10]]
        return cv2.cvtColor(image, getattr(cv2, f"COLOR_Bayer{code}2BGR"))
    return image


def info_field(message, name):
    """A field of a camera_info: ROS 1 has K and D, ROS 2 k and d."""
    return [float(v) for v in getattr(message, name, getattr(message, name.lower(), ()))]


def is_matrix(values):
    return len(values) == 9 and bool(values[0] and values[4])


def projection(message):
    """The camera matrix of rectified images: the left 3x3 of P."""
    values = info_field(message, "P")
    return values[:3] + values[4:7] + values[8:11]


def region_of(message):
    """The part of the sensor that the images of a camera_info have; empty for all of it."""
    roi = getattr(message, "roi", None)
    region = {name: getattr(roi, name, 0) for name in ("x_offset", "y_offset", "width", "height")}
    whole = {"x_offset": (0,), "y_offset": (0,), "width": (0, message.width), "height": (0, message.height)}
    return {} if all(region[name] in whole[name] for name in region) else region


def camera_info_text(message, rectified=False):
    """A camera_info as the YAML of ROS's calibration files, of the raw or the rectified images; None for a camera that
    is not calibrated.
    """
    matrix, lens = (projection(message), []) if rectified else (info_field(message, "K"), info_field(message, "D"))
    if not is_matrix(matrix):
        return None
    binning = "".join(f"{name}: {getattr(message, name)}\n" for name in ("binning_x", "binning_y") if getattr(message, name, 0) > 1)
    region = region_of(message)
    roi = "".join(["roi:\n"] + [f"  {name}: {value}\n" for name, value in region.items()]) if region else ""
    return (f"image_width: {message.width}\nimage_height: {message.height}\n{binning}{roi}camera_matrix:\n  rows: 3\n  cols: 3\n"
            f"  data: {matrix}\ndistortion_model: {message.distortion_model or 'plumb_bob'}\ndistortion_coefficients:\n"
            f"  rows: 1\n  cols: {len(lens)}\n  data: {lens}\n")


def is_rectified_already(message):
    """Whether the raw images of a camera are rectified: no distortion, and one matrix for both."""
    return not any(info_field(message, "D")) and projection(message) == info_field(message, "K")


def rectified_chain(message, np):
    """A camera_info as Kalibr's chain of two cameras at one place: rectified frames, and raw events turned by R. None if
    the chain cannot express it.
    """
    frames, events, lens = projection(message), info_field(message, "K"), info_field(message, "D")
    model = {"plumb_bob": "radtan", "": "radtan", "equidistant": "equidistant", "fisheye": "equidistant"}.get(message.distortion_model)
    turn = info_field(message, "R")
    if not (is_matrix(frames) and is_matrix(events) and len(turn) == 9 and any(turn)):
        return None
    if not model or any(lens[4:]) or region_of(message):
        return None
    if max(getattr(message, "binning_x", 0), getattr(message, "binning_y", 0)) > 1:
        return None
    pose = np.eye(4)
    pose[:3, :3] = np.reshape(turn, (3, 3)).T  # R turns raw to rectified
    cam0, cam1 = (f":\n  camera_model: pinhole\n  intrinsics: {[matrix[k] for k in (0, 4, 2, 5)]}\n"
                  f"  resolution: {[message.width, message.height]}\n  rostopic: {topic}\n"
                  for matrix, topic in ((frames, "/frames"), (events, "/events")))
    return (f"cam0{cam0}  distortion_model: none\n"
            f"cam1{cam1}  distortion_model: {model}\n  distortion_coeffs: {(lens + 4 * [0.0])[:4]}\n  T_cn_cnm1: {pose.tolist()}\n")


class BagReader:
    def __init__(self, folder):
        self.np = need("numpy", "numpy")
        self.out = Output(folder, "ROS bag")
        self.clock = SensorClock()
        self.lengths = {}  # of exposures, by namespace: when the bag has them from, us
        self.pictures = []  # the same for frames: when from, namespace
        self.infos = {}  # the first camera_info, by namespace
        self.rooms = {}  # namespaces of events and frames
        self.frames_topic = ""
        self.alpha = set()  # encodings of images with alpha
        self.skipped = {}

    def take(self, kind, topic, at, raw, ros1, decode):
        room = room_of(topic)
        if kind in ("dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray"):
            self.rooms["events"] = room
            self.out.size, *events = event_array(raw, ros1, self.np)
            self.out.events(*events)
        elif kind == "event_camera_msgs/msg/EventPacket":
            self.rooms["events"] = room
            self.packet(decode())
        elif kind == "sensor_msgs/msg/CameraInfo":
            if room not in self.infos:
                self.infos[room] = decode()
        elif kind == "sensor_msgs/msg/Image":
            message = decode()
            if message.encoding in ("rgba8", "bgra8"):
                self.alpha.add(message.encoding)
            self.picture(message.header, at, topic, to_picture(message, self.np, need("cv2", "opencv-python-headless")))
        elif kind == "sensor_msgs/msg/CompressedImage":
            message, cv2 = decode(), need("cv2", "opencv-python-headless")
            image = cv2.imdecode(self.np.frombuffer(message.data.tobytes(), dtype=self.np.uint8), cv2.IMREAD_UNCHANGED)
            if image is None:
                raise Problem(f"an image of {topic} cannot be decoded ({message.format})")
            self.picture(message.header, at, topic, image)
        elif kind == "std_msgs/msg/Int32" and "exposure" in topic:
            self.lengths.setdefault(room, []).append((at, max(int(decode().data), 0)))
        else:
            self.skipped[topic] = kind

    def packet(self, message):
        self.out.size = message.width, message.height
        if message.encoding == "mono":
            self.out.events(*mono_events(message, self.np))
        elif message.encoding in ("evt3", "evt21", "evt2"):
            data, is_evt3 = message.events.tobytes(), message.encoding == "evt3"
            times, first = sensor_times(data, message.encoding, self.np)
            wraps = self.clock.packet(stamp_us(message.header), times, first, 1 << (24 if is_evt3 else 34))
            if wraps and is_evt3:  # half, the largest time and 0: a wrap in steps that are no damage
                words = [0x87ff, 0x8fff, 0x8000] * wraps + [0x87ff] * (first >> 23) + [0x8000 | first >> 12, 0x6000 | first & 0xfff]
                self.out.words("evt3", self.np.array(words, dtype="<u2").tobytes())
            self.out.words(message.encoding, data)
        else:
            raise Problem(f"event packets of encoding {message.encoding} are not read; expected evt3, evt21, evt2 or mono")

    def picture(self, header, at, topic, image):
        room = self.rooms["frames"] = room_of(topic)
        self.frames_topic = topic
        t = stamp_us(header)
        self.pictures.append((at, room))
        self.out.frame(image, t, t)

    def give_lengths(self):
        """Gives each frame its own exposure time. The DAVIS driver publishes a frame first and its exposure time
        right after it, but a bag stores them in the order of arrival. So use the nearest in time, or the later of
        two equally near ones.
        """
        every = sorted(length for lengths in self.lengths.values() for length in lengths)
        for k, (at, room) in enumerate(self.pictures):
            known = self.lengths.get(room, every)  # in the order of the bag's times
            if not known:
                return
            after = bisect.bisect_left(known, (at,))
            _, length = min(known[max(after - 1, 0):after + 1], key=lambda each: (abs(each[0] - at), -each[0]))
            name, t, _ = self.out.exposures[k]
            start = t - {"start": 0, "middle": length // 2, "end": length}[self.out.stamp]
            self.out.exposures[k] = (name, start, start + length)

    def give_calibration(self):
        """Selects the camera_info of the camera that is read: that of its namespace, or the only one in the bag."""
        own = [room for room in self.infos if room in self.rooms.values()]
        rooms = own or list(self.infos)
        if not rooms:
            return
        if len(rooms) > 1:
            self.out.notes.append("camera_info of several cameras (" + ", ".join(sorted(rooms)) + ") is left out; give "
                                  "--calibration")
            return
        message, rectified = self.infos[rooms[0]], RECTIFIED.search(self.frames_topic) is not None
        if rectified and self.rooms.get("events") == self.rooms["frames"] and not is_rectified_already(message):
            self.give_two_views(message)
            return
        text = camera_info_text(message, rectified)
        if text is None:
            self.out.warnings.append(f"camera_info of {rooms[0] or '/'} holds no calibration (its matrix is zero)")
            return
        (self.out.folder / "camera_info.yaml").write_text(text)

    def give_two_views(self, message):
        """Writes the calibration of rectified frames and raw events."""
        text = rectified_chain(message, self.np)
        found = f"expected frames as the sensor took them, found {self.frames_topic}, which is rectified while events are not; "
        if text is None:
            self.out.warnings.append(found + "its camera_info cannot be used: give raw frames with --frames-topic, or "
                                     "--calibration of both (Kalibr's cam0 for the frames, cam1 for the events)")
            return
        self.out.warnings.append(found + "give raw frames with --frames-topic, or add --plane-depth 1 to jade_import (any "
                                 "depth, because the two views are from one place)")
        (self.out.folder / "camera_info.yaml").write_text(text)

    def finish(self):
        self.give_lengths()
        self.give_calibration()
        if "render" in self.frames_topic.lower():
            self.out.warnings.append(f"expected frames of the scene, found {self.frames_topic}, which may be drawn from the events; "
                                     "choose another topic with --frames-topic")
        if self.alpha:
            self.out.notes.append("frames have an alpha channel (" + ", ".join(sorted(self.alpha)) + "), which is not used")
        out = self.out
        if out.raw is not None and out.exposures:
            out.offset_us = self.clock.offset_us()
            out.notes.append("event times are the sensor's; they were moved by the median delay of the packets' stamps, "
                             f"{out.offset_us} us" if self.clock.ahead else
                             "event times are the sensor's and frames have those of ROS: the clocks differ")
        if self.skipped:
            out.notes.append("topics that are not read: " + ", ".join(f"{t} ({k})" for t, k in sorted(self.skipped.items())))
        return out


def depth_rank(topic, encoding):
    """Preference among topics of images: 0 for 8 bits, 1 for 16 bits or unknown, 2 for possible depth or renderings of
    events.
    """
    if "depth" in topic.lower() or "render" in topic.lower() or encoding in ("mono16", "16UC1", "16SC1", "32FC1", "64FC1"):
        return 2
    return 0 if encoding.endswith("8") or encoding.startswith("8UC") else 1


def image_encodings(bag):
    """Encoding of each topic of images, from its first message; empty if there is only one topic."""
    found = {}
    images = [c for c in bag.connections if c.msgtype == "sensor_msgs/msg/Image"]
    if len({c.topic for c in images}) < 2:
        return found
    for connection in images:
        for _, _, raw in bag.messages([connection]):
            found.setdefault(connection.topic, bag.deserialize(raw, connection.msgtype).encoding)
            break
    return found


def chosen_topics(connections, events, frames, encodings=None):
    """Selects one topic of events and one of frames; ignores the others. Prefers pictures to depth and
    renderings, then the camera of the events, then raw frames to rectified ones. Encodings are those of image_encodings().
    """
    kinds = {"events": ("EventArray", "EventPacket"), "frames": ("Image", "CompressedImage")}
    left, rooms = [], [frames] if frames else []
    for what, wanted in (("events", events), ("frames", frames)):
        topics = [c.topic for c in connections if c.msgtype.split("/")[-1] in kinds[what]]
        topics = sorted(set(topics))
        if wanted and wanted not in topics:
            raise Problem(f"expected a topic of {what}, found none called {wanted}; there are {', '.join(topics) or 'none'}")
        ranks = {topic: depth_rank(topic, (encodings or {}).get(topic, "")) if what == "frames" else 0 for topic in topics}
        keep = wanted or min(topics, default=None, key=lambda topic: (
            ranks[topic] == 2, not in_one_room(topic, rooms), bool(RECTIFIED.search(topic)), ranks[topic], topic))  # noqa: B023
        rooms += [keep] if keep else []
        left += [topic for topic in topics if topic != keep]
    return left


def in_one_room(topic, others):
    """Whether topics are from the same camera, as /davis/left/events and /davis/left/image_raw."""
    return any(room_of(topic) == room_of(other) for other in others)


def index_remedy(path):
    """How to repair a bag whose recorder was stopped before it wrote the index."""
    path = Path(path)
    if path.suffix == ".mcap":
        return f"Copy it again, or run: mcap recover {path.name} -o recovered.mcap"
    if path.is_dir() or path.suffix == ".db3":
        return f"Copy it again, or run: ros2 bag reindex {(path if path.is_dir() else path.resolve().parent).name}"
    return f"Copy it again, or run: rosbag reindex {path.name}"


def read_bag(path, folder, events_topic, frames_topic, stamp):
    need("rosbags", "rosbags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.LATEST)
    store.register(get_types_from_msg(PACKET, "event_camera_msgs/msg/EventPacket"))
    reader = BagReader(folder)
    try:
        with AnyReader([Path(path)], default_typestore=store) as bag:
            left = chosen_topics(bag.connections, events_topic, frames_topic, image_encodings(bag))
            if left:
                reader.out.notes.append("only one topic of events and one of frames is read (--topic chooses the events, "
                                        "--frames-topic the frames); left out: " + ", ".join(left))
            # The DAVIS driver stamps the middle of an exposure; for other drivers the start is most likely.
            davis = any(c.msgtype == "dvs_msgs/msg/EventArray" for c in bag.connections)
            reader.out.stamp = stamp or ("middle" if davis else "start")
            wanted = [c for c in bag.connections if c.topic not in left]
            ros1 = not bag.is2
            for connection, at, raw in bag.messages(wanted):
                reader.take(connection.msgtype, connection.topic, at, raw, ros1,
                            lambda: bag.deserialize(raw, connection.msgtype))
    except Problem as problem:
        raise Problem(f"{path}: {problem}") from problem
    except Exception as error:  # the packages have their own exception types
        check_space(error, folder)
        text = str(error).split("\n")[0]
        raise Problem(f"{path}: cannot be read as a ROS bag: {text}; is it whole? {index_remedy(path)}") from error
    return reader.finish()
