"""Runs one step of COLMAP: python3 pycolmap-step.py STEP OPTIONS, with options as JSON."""

import json
import os
import sys

import pycolmap

step, options = sys.argv[1], json.loads(sys.argv[2])
database = options["database"]
cpu = {"device": pycolmap.Device.cpu}

if step == "features":
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = options["lens"]
    if options["masks"]:
        reader.mask_path = options["masks"]
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.max_image_size = options["size"]
    extraction.sift.max_num_features = options["features"]
    with open(options["list"], encoding="utf-8") as names:
        names = names.read().splitlines()
    mode = pycolmap.CameraMode.SINGLE if options["shared"] else pycolmap.CameraMode.PER_IMAGE
    if options["camera"]:
        reader.existing_camera_id = options["camera"]
    pycolmap.extract_features(database, options["images"], names, mode, reader, extraction, **cpu)
elif step == "all":
    pairing = pycolmap.ExhaustivePairingOptions()
    pairing.block_size = options["block"]
    pycolmap.match_exhaustive(database, pairing_options=pairing, **cpu)
elif step == "pairs":
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = options["pairs"]
    pairing.block_size = 100
    pycolmap.match_image_pairs(database, pairing_options=pairing, **cpu)
else:
    pipeline = pycolmap.IncrementalPipelineOptions()
    pipeline.min_model_size = 3
    if options["relaxed"]:
        pipeline.mapper.init_min_tri_angle = 4
        pipeline.mapper.init_min_num_inliers = 50
        pipeline.mapper.abs_pose_min_num_inliers = 15
    os.makedirs(options["output"], exist_ok=True)
    pycolmap.incremental_mapping(database, options["images"], options["output"], pipeline)
