# SPDX-License-Identifier: Apache-2.0
"""Readers of AEDAT 3.1 (caer, DV before 2019) and AEDAT 2.0 (jAER) recordings of DAVIS cameras, for
read_recording.py.

Both formats are described at docs.inivation.com, "AEDAT 3.1" and "AEDAT 2.0". The latter does not specify how a
DAVIS numbers its pixels; in files of jAER rows count from the bottom, and the columns of events, but not those of
frames, from the right. v2e writes the same, without the name of the camera. read() fills an Output of recording_folder.py; problems are a ValueError of one line.
"""
import collections
import os
import re

import numpy as np

from convert_aedat4 import to_opencv

CONVERT = "convert it to .aedat4: open it in DV (inivation.com) and record it"
DAMAGED = "the file is damaged, copy it again"
# Sensors by the number in the name of the camera.
SIZES = {"128": (128, 128), "208": (208, 192), "240": (240, 180), "346": (346, 260), "640": (640, 480)}

# AEDAT 3.1
HEADER = np.dtype([("type", "<i2"), ("source", "<i2"), ("size", "<i4"), ("time_at", "<i4"), ("overflow", "<i4"),
                   ("capacity", "<i4"), ("number", "<i4"), ("valid", "<i4")])
EVENT = np.dtype([("word", "<u4"), ("t", "<i4")])
FRAME = np.dtype([("info", "<u4"), ("begin", "<i4"), ("end", "<i4"), ("start_of_exposure", "<i4"), ("end_of_exposure", "<i4"),
                  ("width", "<i4"), ("height", "<i4"), ("left", "<i4"), ("top", "<i4")])
Packet = collections.namedtuple("Packet", "kind source size number epoch_us at end")  # its events lie from at to end
SPECIAL, POLARITY, FRAMES, LAST_KNOWN_TYPE = 0, 1, 2, 13
TIMESTAMP_RESET = 1  # among special events
EDGES_3 = ((2, 1), (3, 0))  # special event, whether it is a rising edge of the external input
ORDERS = {1: "GRAY", 3: "RGB", 4: "RGBA"}  # by the number of channels
# OpenCV names a pattern after its second row and second column, the format clockwise: RGBG, GRGB, GBGR, BGRG.
BAYER = {1: "BG", 2: "GB", 3: "GR", 4: "RG"}

# AEDAT 2.0
RECORD = np.dtype([("word", ">u4"), ("t", ">u4")])
CHUNK = 1 << 20  # records
EDGES_2 = ((3, 1), (2, 0))  # low bits of an external event, whether it is a rising edge
RESET_READ, SIGNAL_READ = 0, 1
ADC_TO_16_BIT = 1 << 6
# A larger decrease of the clock is a reset of the camera's timestamps.
RESET_US = 1000000


def read(path, out):
    size = os.path.getsize(path)
    with open(path, "rb") as file:
        version = file.readline(64).strip().decode("ascii", "replace")
        if version == "#!AER-DAT3.1":
            out.form = "AEDAT 3.1"
            Packets(file, size, out).read()
        elif version == "#!AER-DAT2.0":
            out.form = "AEDAT 2.0"
            Records(path, file, size, out).read()
        else:
            raise ValueError(f"expected AEDAT 2.0, 3.1 or 4, found {version}; {CONVERT}")


def cut_short(count):
    return f"the file was cut short: its last {count} bytes are left out"


def longest(parts, out):
    """The (begin, end) with the largest weight among (begin, end, weight), the parts between resets of the clock."""
    best = max(parts, key=lambda part: part[2])
    if len(parts) > 1:
        share = best[2] / max(sum(part[2] for part in parts), 1)
        out.warnings.append(f"the camera's clock was reset {len(parts) - 1} times; only the longest part is read, {share:.0%} of all")
    return best[:2]


class Packets:
    """AEDAT 3.1."""

    def __init__(self, file, size, out):
        self.file, self.size, self.out = file, size, out
        cameras = (re.search(r"(?:davis|dvs)_?(\d{3})", name, re.IGNORECASE) for name in self.read_header())
        out.size = next((SIZES[camera[1]] for camera in cameras if camera and camera[1] in SIZES), None)
        self.first = file.tell()
        self.invalid = self.regions = 0

    def read_header(self):
        """Names of the sources; those of "#-Source" were recorded by another program before."""
        names = []
        while not (line := self.file.readline(1 << 16)).startswith(b"#!END-HEADER"):
            text = line.decode("ascii", "replace").strip()
            if not line.startswith(b"#"):
                raise ValueError(f"expected a header that ends with #!END-HEADER, found none; {DAMAGED}")
            if text.startswith("#Format:") and text[8:].strip() != "RAW":
                raise ValueError(f"expected packets of the format RAW, found {text[8:].strip()}; {CONVERT}")
            if found := re.match(r"#-?Source -?\d+: *(.*)", text):
                names.append(found[1])
        return names

    def packets(self, begin, end):
        """Yields each whole packet that begins between two bytes."""
        while begin < end:
            self.file.seek(begin)
            raw = self.file.read(HEADER.itemsize)
            if len(raw) < HEADER.itemsize:
                return
            kind, source, size, _, overflow, _, number, _ = np.frombuffer(raw, HEADER)[0].tolist()
            least = FRAME.itemsize if kind == FRAMES else 1
            if kind < 0 or size < least or number < 0 or overflow < 0 or (kind < FRAMES and size != EVENT.itemsize):
                raise ValueError(f"expected a packet at byte {begin}, found {number} events of type {kind} and {size} bytes; {DAMAGED}")
            at = begin + HEADER.itemsize
            begin = at + size * number
            if begin > self.size:
                return
            yield Packet(kind, source, size, number, overflow << 31, at, begin)

    def data(self, packet):
        self.file.seek(packet.at)
        return self.file.read(packet.end - packet.at)

    def events(self, packet):
        """Words and times, us, of the valid events of 8 bytes."""
        events = np.frombuffer(self.data(packet), EVENT)
        events = events[events["word"] & 1 == 1]
        self.invalid += packet.number - len(events)
        return events["word"], events["t"].astype(np.int64) + packet.epoch_us

    def special(self, packet):
        word, t = self.events(packet)
        return word >> 1 & 0x7f, t

    def survey(self):
        """Chooses a source and a part of the file, (begin, end), and notes other content."""
        parts, counts, unknown = [[self.first, self.size, 0]], collections.defaultdict(lambda: [0, 0]), collections.Counter()
        whole = self.first
        for packet in self.packets(self.first, self.size):
            whole = packet.end
            if packet.kind in (POLARITY, FRAMES):
                counts[packet.source][packet.kind - POLARITY] += packet.number
            if packet.kind == POLARITY:
                parts[-1][2] += packet.number
            elif packet.kind == SPECIAL and TIMESTAMP_RESET in self.special(packet)[0]:
                parts[-1][1] = packet.at
                parts.append([packet.end, self.size, 0])
            elif packet.kind > LAST_KNOWN_TYPE:
                unknown[packet.kind] += 1
        if whole < self.size:
            self.out.warnings.append(cut_short(self.size - whole))
        if not counts:
            raise ValueError("expected packets of events or frames, found none; record it again")
        if unknown:
            self.out.warnings.append("packets of unknown types are left out: " +
                                  ", ".join(f"{count} of type {kind}" for kind, count in sorted(unknown.items())))
        # A camera with both comes first, then the one with the most events.
        source = max(sorted(counts), key=lambda number: (min(counts[number]) > 0, counts[number][0]))
        if len(counts) > 1:
            others = ", ".join(str(number) for number in sorted(counts) if number != source)
            self.out.notes.append(f"only source {source} is read; left out: {others}")
        return source, longest(parts, self.out)

    def read(self):
        source, part = self.survey()
        self.invalid = 0
        for packet in self.packets(*part):
            if packet.source != source:
                continue
            if packet.kind == POLARITY:
                word, t = self.events(packet)
                self.out.events(word >> 17, word >> 2 & 0x7fff, t, word >> 1 & 1)
            elif packet.kind == SPECIAL:
                kind, t = self.special(packet)
                for edge, rising in EDGES_3:
                    self.out.edges += [(int(time), rising) for time in t[kind == edge]]
            elif packet.kind == FRAMES:
                data = self.data(packet)
                for at in range(0, len(data), packet.size):
                    self.frame(data[at:at + packet.size], packet.epoch_us)
        if self.invalid:
            self.out.warnings.append(f"{self.invalid} events or frames are marked invalid and left out")
        if self.regions:
            self.out.warnings.append(f"{self.regions} frames show a part of the sensor only and are left out")

    def frame(self, data, epoch_us):
        head = np.frombuffer(data, FRAME, 1)[0]
        info, width, height = int(head["info"]), int(head["width"]), int(head["height"])
        if not info & 1:
            self.invalid += 1
            return
        channels, pattern, region = info >> 1 & 7, info >> 4 & 15, info >> 8 & 0x7f
        room = (len(data) - FRAME.itemsize) // 2
        if channels not in ORDERS or min(width, height) < 1 or width * height * channels > room:
            raise ValueError(f"expected a frame of at most {room} values, found {width}x{height} of {channels} channels; {DAMAGED}")
        if self.out.size is None and region == 0:
            self.out.size = width, height
        if region or (width, height) != self.out.size:
            self.regions += 1
            return
        pixels = np.frombuffer(data, "<u2", width * height * channels, FRAME.itemsize).reshape(height, width, channels)
        start, end = (int(head[name]) + epoch_us for name in ("start_of_exposure", "end_of_exposure"))
        if start - end > 1 << 30:  # the counter wrapped during the exposure
            start -= 1 << 31
        self.out.frame(as_picture(pixels, pattern), start, max(start, end))


def as_picture(pixels, pattern):
    """Pixels [H,W,C] of a frame for OpenCV; a mosaic is converted to colours."""
    channels = pixels.shape[2]
    if channels > 1:
        return to_opencv(pixels, ORDERS[channels])
    if pattern == 0:
        return pixels[..., 0]
    if pattern not in BAYER:
        raise ValueError(f"frames behind a colour filter with white pixels (number {pattern}) are not read; {CONVERT}")
    import cv2
    return cv2.cvtColor(np.ascontiguousarray(pixels[..., 0]), getattr(cv2, f"COLOR_Bayer{BAYER[pattern]}2BGR"))


class Records:
    """AEDAT 2.0."""

    def __init__(self, path, file, size, out):
        self.out = out
        lines = self.read_header(file)
        chip = next((found[1] for line in lines if (found := re.match(r"#\s*AEChip:.*?(\w+)$", line))), "")
        camera = re.match(r"davis_?(240|346|640)", chip, re.IGNORECASE)
        self.of_v2e = not chip and any("v2e" in line for line in lines)
        if not camera and not self.of_v2e:
            raise ValueError(f"expected a recording of a DAVIS240, 346 or 640, found {chip or 'no # AEChip'}; {CONVERT}")
        count, rest = divmod(size - file.tell(), RECORD.itemsize)
        if rest:
            out.warnings.append(cut_short(rest))
        if count == 0:
            raise ValueError("expected events behind the header, found none; record it again")
        self.records = np.memmap(path, RECORD, "r", file.tell(), count)
        out.size = self.size_by_events() if self.of_v2e else SIZES[camera[1]]
        self.frames = Readout(out, shutter(lines, chip))
        self.coloured = re.search("colou?r|rgb", chip, re.IGNORECASE) is not None
        self.mosaics, self.beside, self.wraps, self.noise = False, 0, 0, 0

    @staticmethod
    def read_header(file):
        """Lines of text that begin with #, up to the line that ends the header where there is one."""
        lines = []
        while not lines or not re.match("# ?end of ascii header", lines[-1], re.IGNORECASE):
            at = file.tell()
            line = file.readline(1 << 16)
            text = line.decode("latin-1").strip()
            # The first event may begin with the byte of a #.
            if not line.startswith(b"#") or not line.endswith(b"\n") or not text.replace("\t", " ").isprintable():
                file.seek(at)
                break
            lines.append(text)
        return lines

    def size_by_events(self):
        """The smallest sensor of v2e that has all events. v2e writes DAVIS240 and 346 alike, 640x480 with other bits."""
        x = y = 0
        for at in range(0, len(self.records), CHUNK):
            word = self.records["word"][at:at + CHUNK]
            x, y = max(x, int((word >> 12 & 0x3ff).max())), max(y, int((word >> 22 & 0x1ff).max()))
        size = next((SIZES[name] for name in ("240", "346") if x < SIZES[name][0] and y < SIZES[name][1]), None)
        if size is None or y == 0:
            raise ValueError("expected events of a 240x180 or 346x260 sensor, as v2e writes them for --dvs240 and --dvs346, found "
                             "others; let v2e write --dvs_h5 or --dvs_text")
        self.out.notes.append(f"v2e does not name the sensor; by its events it is that of {size[0]}x{size[1]} px" + (
            "; if v2e wrote 346x260 px, of which the left and the top have no events, let it write --dvs_h5 or --dvs_text"
            if size == SIZES["240"] else ""))
        return size

    def chunks(self, begin, end):
        """Yields the start of each piece, its words and its unwrapped times, us."""
        last, epoch = None, 0
        for at in range(begin, end, CHUNK):
            piece = self.records[at:min(at + CHUNK, end)]
            raw = piece["t"].astype(np.int64)
            steps = np.diff(raw, prepend=raw[0] if last is None else last)
            turns = np.cumsum((steps < -(1 << 31)).astype(np.int64) - (steps > 1 << 31))
            t = raw + (epoch + turns << 32)
            epoch, last = epoch + int(turns[-1]), int(raw[-1])
            self.wraps = epoch
            yield at, piece["word"].astype(np.uint32), t

    def survey(self):
        """The (begin, end) of the longest part between resets of the clock."""
        begins, last = [0], None
        for at, _, t in self.chunks(0, len(self.records)):
            steps = np.diff(t, prepend=t[0] if last is None else last)
            begins += (at + np.flatnonzero(steps < -RESET_US)).tolist()
            last = t[-1]
        ends = begins[1:] + [len(self.records)]
        return longest([(begin, end, end - begin) for begin, end in zip(begins, ends)], self.out)

    def read(self):
        width, height = self.out.size
        for _, word, t in self.chunks(*self.survey()):
            sample, special = word >> 31 == 1, word & 0x400 != 0
            dvs = ~sample & (~special | self.of_v2e)  # the special ones of v2e are its noise
            self.noise += int(special.sum()) if self.of_v2e else 0
            x, y = width - 1 - (word[dvs] >> 12 & 0x3ff).astype(np.int64), height - 1 - (word[dvs] >> 22 & 0x1ff).astype(np.int64)
            on_sensor = (x >= 0) & (y >= 0)
            self.beside += int((~on_sensor).sum())
            self.out.events(x[on_sensor], y[on_sensor], t[dvs][on_sensor], (word[dvs] >> 11 & 1)[on_sensor])
            for edge, rising in () if self.of_v2e else EDGES_2:
                self.out.edges += [(int(time), rising) for time in t[~sample & special & (word & 7 == edge)]]
            pixels = sample & (word >> 11 & 1 == 0)  # the others are those of the IMU
            if self.coloured:
                self.mosaics |= bool(pixels.any())
            else:
                self.frames.add(word[pixels], t[pixels])
        self.frames.finish()
        self.tell()

    def tell(self):
        notes, warnings = self.out.notes, self.out.warnings
        if self.wraps:
            notes.append(f"the time counter wraps {self.wraps} times and is continued")
        if self.noise:
            notes.append(f"{self.noise} events that v2e labels as noise are kept")
        if self.beside:
            warnings.append(f"{self.beside} events lie beside the sensor and are left out")
        if self.mosaics:
            notes.append("frames of a colour sensor are not read from AEDAT 2.0; for frames " + CONVERT)


def shutter(lines, chip):
    """Whether the shutter is global, by the settings in the header; None if they do not say."""
    for line in lines:
        if found := re.search(rf'key="{re.escape(chip)}\.APS\.GlobalShutter" value="(true|false)"', line):
            return found[1] == "true"
    return None


class Readout:
    """Frames from samples of the active pixels. Each frame is a read of all pixels after their reset and one of their signal;
    brightness is reset minus signal. With a global shutter the exposure lies between the two; a rolling shutter exposes each
    column from its reset read to its signal read."""

    def __init__(self, out, is_global):
        self.out, self.is_global = out, is_global
        self.word, self.t = np.zeros(0, np.uint32), np.zeros(0, np.int64)
        self.lacking = self.unknown = self.rolling = self.skew_us = 0

    def add(self, word, t):
        self.word, self.t = np.concatenate([self.word, word]), np.concatenate([self.t, t])
        resets = np.flatnonzero(self.word >> 10 & 3 == RESET_READ)
        x, y = ((self.word[resets] >> shift & mask).astype(np.int64) for shift, mask in ((12, 0x3ff), (22, 0x1ff)))
        # Within a frame consecutive reads differ by one column or one row.
        starts = resets[1:][(abs(np.diff(x)) > 1) & (abs(np.diff(y)) > 1)]
        begin = 0
        for end in starts:
            self.frame(self.word[begin:end], self.t[begin:end])
            begin = end
        self.word, self.t = self.word[begin:], self.t[begin:]
        if len(self.word) > 4 * self.out.size[0] * self.out.size[1]:  # reads without their resets
            self.lacking += 1
            self.word, self.t = self.word[:0], self.t[:0]

    def frame(self, word, t):
        width, height = self.out.size
        x, y = word >> 12 & 0x3ff, height - 1 - (word >> 22 & 0x1ff).astype(np.int64)
        inside, kind = (x < width) & (y >= 0), word >> 10 & 3
        values, times = np.full((2, height, width), -1, np.int32), np.zeros((2, height, width), np.int64)
        for read in (RESET_READ, SIGNAL_READ):
            these = inside & (kind == read)
            values[read][y[these], x[these]] = word[these] & 0x3ff
            times[read][y[these], x[these]] = t[these]
        if (values < 0).any():
            self.lacking += 1
            return
        image = (np.maximum(values[RESET_READ] - values[SIGNAL_READ], 0) * ADC_TO_16_BIT).astype(np.uint16)
        overlapping = times[RESET_READ].max() > times[SIGNAL_READ].min()
        if overlapping or self.is_global is False:
            start, end = (int(times[read].min() + times[read].max()) // 2 for read in (RESET_READ, SIGNAL_READ))
            self.rolling, self.skew_us = self.rolling + 1, int(np.ptp(times[RESET_READ])) // 2
        else:
            start, end = int(times[RESET_READ].max()), int(times[SIGNAL_READ].min())
            if self.is_global is None:
                self.unknown += 1
                start = end = (start + end) // 2
        self.out.frame(image, start, max(start, end))

    def finish(self):
        if len(self.word):
            self.frame(self.word, self.t)
        notes = self.out.notes
        if self.lacking:
            self.out.warnings.append(f"{self.lacking} frames lack reads of pixels and are left out")
        if self.rolling:
            notes.append(f"{self.rolling} frames have a rolling shutter: their times are those of the middle column, the first "
                         f"and the last differ by {self.skew_us} us")
        if self.unknown:
            notes.append("the header does not say whether the shutter is global; the length of exposures is not known, their "
                         "middle is")
