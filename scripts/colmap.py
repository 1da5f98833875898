#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Implements the COLMAP commands that jade_import uses, with the Python package pycolmap instead of the program.

    colmap.py feature_extractor|exhaustive_matcher|matches_importer|mapper|global_mapper --NAME VALUE ...
    colmap.py reverse_depths --database_path FILE --image_path DIR --input_path MODEL --output_path MODEL
                             --refine_focal_length 0|1
    colmap.py version

reverse_depths is not a command of the program. A camera with a narrow view and little motion sees almost the same
if near and far are exchanged and the camera moves the other way (Necker reversal), and incremental mapping ends
in either by chance. The command mirrors the model, adjusts it, and writes it only if its error is clearly
smaller. It prints both errors.

Flags have the program's names: --database_path, --image_path, --output_path, --SiftExtraction.first_octave and so
on.
"""
import sys
from pathlib import Path

# Options that pycolmap has in another group than the program.
MOVED = {
    "SiftExtraction.use_gpu": "extraction.use_gpu",
    "SiftMatching.use_gpu": "matching.use_gpu",
    "SiftMatching.guided_matching": "matching.guided_matching",
    "Mapper.ba_global_images_ratio": "pipeline.ba_global_frames_ratio",
    "Mapper.tri_min_angle": "pipeline.triangulation.min_angle",
    "Mapper.init_min_tri_angle": "pipeline.mapper.init_min_tri_angle",
    "Mapper.filter_min_tri_angle": "pipeline.mapper.filter_min_tri_angle",
    "GlobalMapper.ba_refine_focal_length": "global.mapper.bundle_adjustment.refine_focal_length",
    "GlobalMapper.ba_refine_principal_point": "global.mapper.bundle_adjustment.refine_principal_point",
    "GlobalMapper.ba_refine_extra_params": "global.mapper.bundle_adjustment.refine_extra_params",
}
GROUPS = {"ImageReader": "reader", "SiftExtraction": "extraction.sift", "SiftMatching": "matching.sift",
          "Mapper": "pipeline", "GlobalMapper": "global"}
PAIRS_PER_BLOCK = 100  # the log has one line per block
TRACKS = 600  # the longest ones, which decide between a model and its reverse
ADJUSTMENTS = 40  # iterations
CLEARLY_FINER = 0.9  # of the error


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


def adjustment(refine_focal_length, robust):
    import pycolmap

    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = refine_focal_length
    options.refine_principal_point = options.refine_extra_params = False
    options.print_summary = False
    options.ceres.solver_options.max_num_iterations = ADJUSTMENTS
    if robust:
        options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    return options


def median_error(model):
    """Reprojection error of the points, px."""
    import numpy as np

    model.update_point_3d_errors()
    return float(np.median([point.error for point in model.points3D.values()]))


def reverse(model):
    """Mirrors the depths of points about their median in the mean camera, and each camera's rotation relative to
    that camera. The middle point stays where each camera sees it, and the picture of the mean camera does not
    change.
    """
    import numpy as np
    import pycolmap

    images = [image for image in model.images.values() if image.has_pose]
    turns = np.stack([image.cam_from_world().rotation.matrix() for image in images])
    moves = np.stack([image.cam_from_world().translation for image in images])
    centre = -np.einsum("nji,nj->ni", turns, moves).mean(0)
    u, _, v = np.linalg.svd(turns.mean(0))
    mean = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    seen = np.stack([point.xyz for point in model.points3D.values()]) - centre
    seen = seen @ mean.T
    ahead = seen[:, 2] > 0
    depth = np.median(seen[ahead, 2])
    mirrored = 1 / np.maximum(2 / depth - 1 / seen[ahead, 2], 0.05 / depth)
    seen[ahead] *= (mirrored / seen[ahead, 2])[:, None]
    for point, place in zip(model.points3D.values(), seen @ mean + centre):
        point.xyz = place
    middle = mean.T @ np.array([0, 0, depth]) + centre
    flip = np.diag([1.0, 1.0, -1.0])
    for image, turn, move in zip(images, turns, moves):
        other = flip @ turn @ mean.T @ flip @ mean
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(other), turn @ middle + move - other @ middle)
        model.frame(image.frame_id).set_cam_from_world(image.camera_id, pose)


def reverse_depths(paths):
    import pycolmap

    focal = path_of(paths, "refine_focal_length") == "1"
    output = path_of(paths, "output_path")
    model = pycolmap.Reconstruction(path_of(paths, "input_path"))
    longest = sorted(model.points3D, key=lambda key: -model.points3D[key].track.length())
    for key in longest[TRACKS:]:
        model.delete_point3D(key)
    if not longest:
        return
    before = median_error(model)
    reverse(model)
    pycolmap.bundle_adjustment(model, adjustment(focal, robust=True))
    after = median_error(model)
    print(f"reverse_depths: median error {before:.3f} px, reversed {after:.3f} px", flush=True)
    if after > CLEARLY_FINER * before:
        return
    Path(output).mkdir(parents=True, exist_ok=True)
    # Triangulates all points again, from the matches.
    model = pycolmap.triangulate_points(model, path_of(paths, "database_path"), path_of(paths, "image_path"), output)
    pycolmap.bundle_adjustment(model, adjustment(focal, robust=False))
    model.update_point_3d_errors()
    model.write(output)


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
    if command == "reverse_depths":
        reverse_depths(paths)
        return
    objects = {"reader": pycolmap.ImageReaderOptions(), "extraction": pycolmap.FeatureExtractionOptions(),
               "matching": pycolmap.FeatureMatchingOptions(), "pipeline": pycolmap.IncrementalPipelineOptions()}
    if command == "global_mapper":
        if not hasattr(pycolmap, "global_mapping"):
            fail(f"pycolmap {pycolmap.__version__} has no global mapping; expected 4.0 or later")
        objects["global"] = pycolmap.GlobalPipelineOptions()
    single = options.pop("ImageReader.single_camera", "0") == "1"
    if not hasattr(objects["pipeline"], "random_seed"):  # older versions
        options.pop("Mapper.random_seed", None)
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
    elif command == "global_mapper":
        models = path_of(paths, "output_path")
        Path(models).mkdir(parents=True, exist_ok=True)
        pycolmap.global_mapping(database, path_of(paths, "image_path"), models, options=objects["global"])
    else:
        fail(f"{command}: expected feature_extractor, exhaustive_matcher, matches_importer, mapper, global_mapper or "
             "reverse_depths")


if __name__ == "__main__":
    main()
