# SPDX-License-Identifier: Apache-2.0
"""Writes the folder of a converted recording, and reports problems in one line; for read_recording.py.

A folder gets events.h5 (x, y, t in microseconds, p) or, for packets in Prophesee's encodings, events.raw as the
sensor sent them; images/*.png with exposures.csv (name,start_us,end_us: equal if the recording does not contain
the exposure time); triggers.csv (t_us,rising), camera_info.yaml (of a bag that has one for the camera) and
recording.txt ("key value": format, width, height, stamp, offset_us of events and triggers, note, warning).
"""
import errno
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from convert_aedat4 import CACHE_BYTES, EventWriter  # noqa: E402

DATA_ERROR, PACKAGE_MISSING = 3, 4
FULL = (errno.ENOSPC, errno.EDQUOT)
INSTALL = "run scripts/setup.sh --import, or pip install 'jade-gs[import]'"


class Problem(Exception):
    """A one-line error that ends the conversion."""


def need(module, package):
    try:
        return __import__(module)
    except ImportError:
        print(f"needs the Python package {package}: {INSTALL}", file=sys.stderr)
        sys.exit(PACKAGE_MISSING)


def is_full(error):
    """Whether the error means that a disk or a quota is full; HDF5 says so only in its text."""
    told = any(os.strerror(code) in str(error) for code in FULL)
    return isinstance(error, OSError) and (error.errno in FULL or told)


def no_space(folder):
    return f"no space in {folder}; make some, or set TMPDIR to a folder that has it"


def check_space(error, folder):
    """Reports a full disk, for which the recording is not to blame."""
    if is_full(error):
        raise Problem(no_space(folder)) from error


class Output:
    """The output folder. Memory does not grow with the recording."""

    def __init__(self, folder, form):
        self.folder, self.form = Path(folder), form
        self.folder.mkdir(parents=True, exist_ok=True)
        self.forget_earlier()
        self.size = None
        self.stamp = "middle"
        self.offset_us = 0
        self.notes, self.warnings = [], []
        self.exposures, self.edges = [], []
        self.writer = self.h5 = self.raw = self.encoding = None
        self.event_count = 0

    def forget_earlier(self):
        """Removes earlier output of this script, which would be read as a part of the new recording. recording.txt,
        written last, proves that it was this script.
        """
        if not (self.folder / "recording.txt").is_file():
            return
        names = ("recording.txt", "events.h5", "events.raw", "exposures.csv", "triggers.csv", "camera_info.yaml", "images/" + 6 * "[0-9]" + ".png")
        for path in [path for name in names for path in self.folder.glob(name)]:
            path.unlink()

    def events(self, x, y, t_us, p):
        if self.h5 is None:
            self.h5 = need("h5py", "h5py").File(self.folder / "events.h5", "w", rdcc_nbytes=CACHE_BYTES)
            self.writer = EventWriter(self.h5)
        self.writer.append(x, y, t_us, p)
        self.event_count += len(t_us)

    def words(self, encoding, data):
        """Writes bytes of a Prophesee stream."""
        if self.raw is None:
            width, height = self.size
            version = {"evt3": "3.0", "evt21": "2.1", "evt2": "2.0"}[encoding]
            self.raw, self.encoding = open(self.folder / "events.raw", "wb"), encoding
            self.raw.write(f"% evt {version}\n% geometry {width}x{height}\n% end\n".encode())
        if encoding != self.encoding:
            raise Problem(f"expected event packets of one encoding, found {self.encoding} and {encoding}")
        self.raw.write(data)

    def frame(self, image, start_us, end_us):
        cv2 = need("cv2", "opencv-python-headless")
        name = f"{len(self.exposures):06d}"
        (self.folder / "images").mkdir(exist_ok=True)
        if not cv2.imwrite(str(self.folder / "images" / f"{name}.png"), image):
            raise Problem(f"{self.folder}: an image cannot be written; check the free space")
        self.exposures.append((name, start_us, end_us))

    def close(self):
        for file in (self.h5, self.raw):
            if file is not None:
                file.close()
        if self.exposures:
            lines = "".join(f"{name},{start},{end}\n" for name, start, end in self.exposures)
            (self.folder / "exposures.csv").write_text("name,start_us,end_us\n" + lines)
        if self.edges:
            lines = "".join(f"{t},{rising}\n" for t, rising in sorted(self.edges))
            (self.folder / "triggers.csv").write_text("t_us,rising\n" + lines)
        lines = [f"format {self.form}", f"stamp {self.stamp}", f"offset_us {self.offset_us}"]
        if self.size:
            lines += [f"width {self.size[0]}", f"height {self.size[1]}"]
        lines += [f"note {note}" for note in self.notes] + [f"warning {fault}" for fault in self.warnings]
        (self.folder / "recording.txt").write_text("\n".join(lines) + "\n")
