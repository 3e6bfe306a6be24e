"""Runs a command of COLMAP by PyCOLMAP: PROGRAM COMMAND --Group.option VALUE ..."""

import sys


def commands():
    """The functions of PyCOLMAP by COLMAP's names of commands, and the groups of their options."""
    extraction = pycolmap.FeatureExtractionOptions()
    reader = {"ImageReader": [pycolmap.ImageReaderOptions()]}
    matching = {"FeatureMatching": [pycolmap.FeatureMatchingOptions()]}
    incremental = pycolmap.IncrementalPipelineOptions()
    return {
        "feature_extractor": (
            pycolmap.extract_features,
            {"extraction_options": "FeatureExtraction", "reader_options": "ImageReader"},
            {**reader, "FeatureExtraction": [extraction], "SiftExtraction": [extraction.sift]},
        ),
        "exhaustive_matcher": (
            pycolmap.match_exhaustive,
            {"matching_options": "FeatureMatching", "pairing_options": "ExhaustiveMatching"},
            {**matching, "ExhaustiveMatching": [pycolmap.ExhaustivePairingOptions()]},
        ),
        "sequential_matcher": (
            pycolmap.match_sequential,
            {"matching_options": "FeatureMatching", "pairing_options": "SequentialMatching"},
            {**matching, "SequentialMatching": [pycolmap.SequentialPairingOptions()]},
        ),
        "matches_importer": (
            pycolmap.match_image_pairs,
            {"matching_options": "FeatureMatching", "pairing_options": "ImportedPairs"},
            {**matching, "ImportedPairs": [pycolmap.ImportedPairingOptions()]},
        ),
        "mapper": (
            pycolmap.incremental_mapping,
            {"options": "Mapper"},
            {"Mapper": [incremental, incremental.mapper]},
        ),
        "global_mapper": (
            pycolmap.global_mapping,
            {"options": "GlobalMapper"},
            {"GlobalMapper": [pycolmap.GlobalPipelineOptions()]},
        ),
    }


def put(owners, name, text):
    """Sets an option, in its own type."""
    owner = next((owner for owner in owners if hasattr(owner, name)), None)
    if owner is None:
        raise ValueError(f"PyCOLMAP {pycolmap.__version__} has no option {name}")
    readers = {bool: lambda text: text == "1", int: int, float: float}
    setattr(owner, name, readers.get(type(getattr(owner, name)), str)(text))


def run(command, words):
    """Runs a command with the options in `words`."""
    function, arguments, groups = commands()[command]
    given = {}
    for option, text in zip(words[::2], words[1::2]):
        group, _, name = option[2:].rpartition(".")
        if option == "--image_list_path":
            with open(text, encoding="utf-8") as names:
                given["image_names"] = names.read().splitlines()
        elif option == "--ImageReader.single_camera":
            given["camera_mode"] = pycolmap.CameraMode.SINGLE
        elif option == "--match_list_path":
            put(groups["ImportedPairs"], "match_list_path", text)
        elif option == "--match_type":
            pass  # PyCOLMAP's function takes pairs only.
        elif group:
            put(groups[group], name, text)
        else:
            given[name] = text
    given.update({argument: groups[group][0] for argument, group in arguments.items()})
    function(**given)


def main():
    command, *words = sys.argv[1:]
    if command == "help":
        gpu = "with CUDA" if pycolmap.has_cuda else "without CUDA"
        print(f"COLMAP {pycolmap.__version__} -- PyCOLMAP ({gpu})", *commands())
    elif words == ["-h"]:
        groups = commands()[command][2]
        print(*(f"--{group}.{name}" for group in groups for name in dir(groups[group][0])))
    else:
        run(command, words)


# Modules in the folder that the user is in are not meant.
sys.path[:] = [folder for folder in sys.path if folder]
try:
    import pycolmap
except ImportError as error:
    sys.exit(f"no PyCOLMAP: {error}")
try:
    main()
except Exception as error:
    print(f"ERROR: {type(error).__name__}: {error}", file=sys.stderr)
    sys.exit(2)
