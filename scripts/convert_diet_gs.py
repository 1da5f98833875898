#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Converts the event pickles of a DiET-GS scene to files that JADE-GS reads.

    scripts/convert_diet_gs.py SCENE [SCENE ...]

Reads SCENE/events/{events,id_to_coords,image_start,image_end}.pickle and, if present, id_to_color.pickle. Writes
beside them
    events.h5        x, y float32, t int64 (microseconds), p int8 (-1 or 1)
    timestamps.npz   timestamps_start, timestamps_end: one window per blurry frame
    color_map.npy    bool [3, H, W]: colour of the events at each pixel
The scene's images/ and sparse/0 are used unchanged. Needs numpy, h5py and, because the pickles contain its
tensors, torch.

Opening a pickle can run code. This script allows only numbers, numpy arrays and torch tensors, and rejects
everything else.
"""
import argparse
import io
import pathlib
import pickle
import sys

try:
    import h5py
    import numpy as np
except ImportError as error:
    print(f"convert_diet_gs: {error}; run .venv/bin/python -m pip install h5py once, then this with .venv/bin/python", file=sys.stderr)
    sys.exit(2)

CHUNK = 1 << 22
ALLOWED = {
    ("collections", "OrderedDict"),
    ("numpy", "dtype"), ("numpy", "ndarray"),
    ("numpy.core.multiarray", "_reconstruct"), ("numpy._core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"), ("numpy._core.multiarray", "scalar"),
    ("numpy.core.numeric", "_frombuffer"), ("numpy._core.numeric", "_frombuffer"),
    ("torch._utils", "_rebuild_tensor_v2"), ("torch._utils", "_rebuild_tensor"),
}


class DataError(Exception):
    """An error for the user: what was expected, what was found, what to do, in one line."""


def storage_from_bytes(data):
    """Replaces torch.storage._load_from_bytes, without running code from the bytes."""
    import torch
    return torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)


class SafeUnpickler(pickle.Unpickler):
    def find_class(self, module, name):
        if (module, name) == ("torch.storage", "_load_from_bytes"):
            return storage_from_bytes
        if (module, name) not in ALLOWED and not (
                module.startswith("numpy.dtypes") or (module == "torch" and name.endswith("Storage"))):
            raise pickle.UnpicklingError(f"refused to load {module}.{name}")
        return super().find_class(module, name)


def load(path):
    """The array in a pickle, as numpy; None if there is no such file."""
    if not path.exists():
        return None
    try:
        with open(path, "rb") as file:
            value = SafeUnpickler(file).load()
    except Exception as plain_error:
        # torch.save writes zip files or its own pickles rather than plain ones.
        try:
            import torch
            value = torch.load(path, map_location="cpu", weights_only=True)
        except Exception:
            raise DataError(f"{path}: cannot be read: {str(plain_error).partition(chr(10))[0]}; copy it again") from plain_error
    if hasattr(value, "detach"):
        value = value.detach().cpu().numpy()
    elif isinstance(value, (list, tuple)):
        value = [v.item() if hasattr(v, "item") else v for v in value]
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.empty(0, object)
    if array.dtype.kind not in "biuf":
        raise DataError(f"{path}: expected an array of numbers, found {type(value).__name__}; copy it again")
    return array


def need(folder, name):
    array = load(folder / name)
    if array is None:
        raise DataError(f"{folder / name}: missing; copy the scene's events folder again")
    return array


def check_events(folder, rows, coords):
    if rows.ndim != 2 or rows.shape[1] < 3:
        raise DataError(f"{folder / 'events.pickle'}: expected rows of id, time, polarity; found shape {rows.shape}")
    if coords.ndim != 2 or coords.shape[1] != 2:
        raise DataError(f"{folder / 'id_to_coords.pickle'}: expected [K, 2], found {coords.shape}")
    for begin in range(0, len(rows), CHUNK):
        block = rows[begin:begin + CHUNK, :2]
        if not np.isfinite(block).all():
            raise DataError(f"{folder / 'events.pickle'}: expected finite numbers, found NaN or Inf; copy it again")
        ids = block[:, 0]
        # A negative id would index from the end of the table.
        beyond = ids[(ids < 0) | (ids >= len(coords))]
        if len(beyond):
            raise DataError(f"{folder / 'events.pickle'}: expected ids from 0 to {len(coords) - 1}, the last of id_to_coords.pickle, "
                            f"found {beyond[0]:.0f}; the two belong to different scenes or one is damaged, copy both again")


def write_events(path, rows, coords):
    """rows: coordinate id, time in us, polarity. Sorts them by time if necessary."""
    if len(rows) and np.any(np.diff(rows[:, 1]) < 0):
        print("  events were out of order in time and have been sorted")
        rows = rows[np.argsort(rows[:, 1], kind="stable")]
    part = path.with_suffix(".part")
    kinds = {"x": np.float32, "y": np.float32, "t": np.int64, "p": np.int8}
    try:
        with h5py.File(part, "w") as file:
            out = {name: file.create_dataset(name, (len(rows),), kind, compression="gzip", shuffle=True,
                                             chunks=(1 << 16,) if len(rows) > 1 << 16 else True)
                   if len(rows) else file.create_dataset(name, (0,), kind)
                   for name, kind in kinds.items()}
            for begin in range(0, len(rows), CHUNK):
                block = rows[begin:begin + CHUNK]
                at = coords[block[:, 0].astype(np.int64)]
                end = begin + len(block)
                out["x"][begin:end] = at[:, 0]
                out["y"][begin:end] = at[:, 1]
                out["t"][begin:end] = np.rint(block[:, 1]).astype(np.int64)
                out["p"][begin:end] = np.where(block[:, 2] > 0, 1, -1)
    except BaseException:  # a full disk, Ctrl-C
        part.unlink(missing_ok=True)
        raise
    part.rename(path)


def convert(scene):
    folder = scene / "events"
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; give the folder of a DiET-GS scene")
    start = need(folder, "image_start.pickle").reshape(-1)
    end = need(folder, "image_end.pickle").reshape(-1)
    if len(start) != len(end):
        raise DataError(f"{folder}: {len(start)} starts and {len(end)} ends of exposures; copy the scene's events folder again")
    rows, coords = need(folder, "events.pickle"), need(folder, "id_to_coords.pickle")
    check_events(folder, rows, coords)
    color = load(folder / "id_to_color.pickle")
    if color is not None and (color.ndim != 3 or color.shape[2] != 3):
        raise DataError(f"{folder / 'id_to_color.pickle'}: expected [H, W, 3], found {color.shape}")
    np.savez(folder / "timestamps.npz", timestamps_start=np.rint(start).astype(np.int64),
             timestamps_end=np.rint(end).astype(np.int64))
    write_events(folder / "events.h5", rows, coords)
    if color is not None:
        np.save(folder / "color_map.npy", np.ascontiguousarray(color.astype(bool).transpose(2, 0, 1)))
    print(f"{scene}: {len(start)} exposures, {len(rows)} events"
          + (", colour map" if color is not None else ""))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="+", type=pathlib.Path, help="folder of a DiET-GS scene")
    for scene in parser.parse_args().scene:
        try:
            convert(scene)
        except KeyboardInterrupt:
            print("convert_diet_gs: interrupted", file=sys.stderr)
            return 130
        except (DataError, OSError) as error:
            print(f"convert_diet_gs: {error}", file=sys.stderr)
            return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
