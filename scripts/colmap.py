#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Takes the calls that jade_import makes of COLMAP, where not the program but the Python package pycolmap is there.

    colmap.py feature_extractor|exhaustive_matcher|matches_importer|mapper --NAME VALUE ...
    colmap.py version

Names are those of the program: --database_path, --image_path, --output_path, --SiftExtraction.first_octave and so on.
"""
import sys
from pathlib import Path

# Options that pycolmap keeps in another group than the program.
MOVED = {
    "SiftExtraction.use_gpu": "extraction.use_gpu",
    "SiftMatching.use_gpu": "matching.use_gpu",
    "SiftMatching.guided_matching": "matching.guided_matching",
    "Mapper.ba_global_images_ratio": "pipeline.ba_global_frames_ratio",
    "Mapper.tri_min_angle": "pipeline.triangulation.min_angle",
    "Mapper.init_min_tri_angle": "pipeline.mapper.init_min_tri_angle",
    "Mapper.filter_min_tri_angle": "pipeline.mapper.filter_min_tri_angle",
}
GROUPS = {"ImageReader": "reader", "SiftExtraction": "extraction.sift", "SiftMatching": "matching.sift",
          "Mapper": "pipeline"}
PAIRS_PER_BLOCK = 100  # each of which the log tells of


def fail(text):
    print(text, file=sys.stderr)
    sys.exit(1)


def parse(words):
    """The paths among the flags, and the options."""
    if len(words) % 2 or any(not word.startswith("--") for word in words[::2]):
        fail(f"expected pairs of --name and value, found {' '.join(words)}")
    paths, options = {}, {}
    for name, value in zip(words[::2], words[1::2]):
        (options if "." in name else paths)[name[2:]] = value
    return paths, options


def path_of(paths, name):
    if name not in paths:
        fail(f"expected --{name}, found none")
    return paths[name]


def set_option(objects, name, value):
    group, _, field = name.partition(".")
    place = MOVED.get(name) or (f"{GROUPS[group]}.{field}" if group in GROUPS else None)
    if place is None:
        fail(f"--{name}: no such option")
    target, *middle, field = place.split(".")
    holder = objects[target]
    for step in middle:
        holder = getattr(holder, step)
    if not hasattr(holder, field):
        fail(f"--{name}: this pycolmap has no such option")
    kind = type(getattr(holder, field))
    setattr(holder, field, value == "1" if kind is bool else kind(value))


def main():
    if len(sys.argv) < 2:
        fail("expected a command, found none; see the head of this file")
    try:
        import pycolmap
    except ImportError as error:
        fail(f"needs the Python package pycolmap: {error}")
    command, words = sys.argv[1], sys.argv[2:]
    if command == "version":
        print(f"pycolmap {pycolmap.__version__}")
        return
    paths, options = parse(words)
    objects = {"reader": pycolmap.ImageReaderOptions(), "extraction": pycolmap.FeatureExtractionOptions(),
               "matching": pycolmap.FeatureMatchingOptions(), "pipeline": pycolmap.IncrementalPipelineOptions()}
    single = options.pop("ImageReader.single_camera", "0") == "1"
    for name, value in options.items():
        set_option(objects, name, value)
    database = path_of(paths, "database_path")
    if command == "feature_extractor":
        mode = pycolmap.CameraMode.SINGLE if single else pycolmap.CameraMode.AUTO
        pycolmap.extract_features(database, path_of(paths, "image_path"), camera_mode=mode, reader_options=objects["reader"],
                                  extraction_options=objects["extraction"])
    elif command == "exhaustive_matcher":
        pycolmap.match_exhaustive(database, matching_options=objects["matching"])
    elif command == "matches_importer":
        if paths.get("match_type", "pairs") != "pairs":
            fail(f"--match_type: expected pairs, found {paths['match_type']}")
        listed = pycolmap.ImportedPairingOptions()
        listed.match_list_path = path_of(paths, "match_list_path")
        listed.block_size = PAIRS_PER_BLOCK
        pycolmap.match_image_pairs(database, matching_options=objects["matching"], pairing_options=listed)
    elif command == "mapper":
        models = path_of(paths, "output_path")
        Path(models).mkdir(parents=True, exist_ok=True)
        pycolmap.incremental_mapping(database, path_of(paths, "image_path"), models, options=objects["pipeline"])
    else:
        fail(f"{command}: expected feature_extractor, exhaustive_matcher, matches_importer or mapper")


if __name__ == "__main__":
    main()
