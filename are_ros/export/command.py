"""`are export` without the shell: a recording in, files for other programs out."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import permutations
from pathlib import Path
from typing import Final

import numpy as np

from are_ros.bag.recording import find_recording, walls_of
from are_ros.conventions import NS_PER_S
from are_ros.draw.scene import Moment, SceneRecord
from are_ros.draw.viewer import rounding_note
from are_ros.errors import BagError, InputError, MapError
from are_ros.export.coco import export_coco
from are_ros.export.kitti import export_kitti
from are_ros.export.scene_mesh import ENVIRONMENT, scene_parts, write_scene, writer_of
from are_ros.export.tracks import export_tracks
from are_ros.parameters.model import WorldParameters
from are_ros.replay.output_folder import no_empty_folders
from are_ros.replay.pictures import place_of
from are_ros.replay.progress import OpenProgress, ProgressBar, Say
from are_ros.replay.recorded_scene import RecordedScene, read_recorded_scene
from are_ros.wording import counted
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_files.octomap import read_voxel_file
from are_ros.world.voxel_map import VoxelMap

_WITHOUT_OCTOMAP: Final = (
    "the walls of the map stand in for the octomap of the run, which the recording does not hold: "
    "give it with --octomap"
)


def export_mesh(
    say: Say, recording: Path, mesh: Path, at_s: float | None, octomap_file: Path | None
) -> None:
    """Write the mesh of the scene at a time, and say what it is. Raises AreError.

    `at_s` is the time from the first tick on, None for the last tick. `octomap_file` goes before
    what the recording holds.
    """
    writer_of(mesh)
    with ProgressBar("reading") as bar:
        scene = read_recorded_scene(recording, bar.open)
    if octomap_file is not None:
        voxels = _voxels_of_file(octomap_file, scene.parameters.world)
        scene = replace(scene, voxels=voxels, cloud_problem="")
    moment = moment_at(scene.record, at_s, scene.parameters.builder.tick_rate)
    place = place_of(scene.parameters, scene.grid, scene.voxels, camera=None)
    parts = scene_parts(place, scene.parameters.world, moment)
    length_bytes = write_scene(mesh, parts)
    triangles = sum(len(part.faces) for part in parts if part.name == ENVIRONMENT)
    shown_s = (moment.stamp_ns - int(scene.record.series.stamps_ns[0])) / NS_PER_S
    say(
        f"mesh: {mesh} ({length_bytes / 1e6:.1f} MB, at {shown_s:g} s: "
        f"{counted(len(moment.artefacts), 'artefact')}, an environment of "
        f"{counted(triangles, 'triangle')})"
    )
    for problem in filter(None, [*_problems(recording, scene), rounding_note(scene.grid)]):
        say(problem)


def export_sets(
    say: Say, recording: Path, folders: Mapping[str, Path | None], cloud: str, image: str
) -> None:
    """Write the data sets whose folders are given, and say what they are. Raises AreError.

    `cloud` and `image` name the topics of the augmented cloud and of the painted image, empty where
    there is one only.
    """
    wanted = {name: folder for name, folder in folders.items() if folder is not None}
    writers: dict[str, Callable[[Path, Path, OpenProgress], str]] = {
        "tracks": export_tracks,
        "kitti": partial(export_kitti, cloud=cloud),
        "coco": partial(export_coco, image=image),
    }
    for folder in wanted.values():
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise BagError(f"{folder}: it is there already, and not empty; give a new folder")
    for (name, folder), (other, within) in permutations(wanted.items(), 2):
        if folder.resolve() in (within.resolve(), *within.resolve().parents):
            raise BagError(
                f"--{other} {within}: --{name} writes into {folder}; give each set a new folder of"
                " its own"
            )
    for name, folder in wanted.items():
        was_there = folder.is_dir()
        with no_empty_folders(folder):
            try:
                with ProgressBar(name) as bar:
                    sentence = writers[name](recording, folder, bar.open)
            except BaseException:  # a Ctrl-C, too: half a set looks like a whole one
                shutil.rmtree(folder, ignore_errors=True)
                if was_there:
                    folder.mkdir(exist_ok=True)
                raise
        say(sentence)


def moment_at(record: SceneRecord, at_s: float | None, tick_rate_hz: float) -> Moment:
    """Return the last tick that is not after a time from the first tick on; None: the last of all.

    What a node sends at its end, when nobody is there any more, is at no tick's time, and does not
    count. Raises BagError for a time after the last tick.
    """
    stamps_ns = record.series.stamps_ns
    if at_s is None:
        at_ticks_ns = stamps_ns[stamps_ns % round(NS_PER_S / tick_rate_hz) == 0]
        return record.moment(int((at_ticks_ns if len(at_ticks_ns) else stamps_ns)[-1]))
    wanted_ns = int(stamps_ns[0]) + round(at_s * NS_PER_S)
    if wanted_ns > stamps_ns[-1]:
        last_s = int(stamps_ns[-1] - stamps_ns[0]) / NS_PER_S
        raise BagError(f"--at {at_s:g}: the last tick of the recording is at {last_s:g} s")
    return record.moment(int(stamps_ns[np.searchsorted(stamps_ns, wanted_ns, side="right") - 1]))


def _voxels_of_file(path: Path, world: WorldParameters) -> VoxelMap:
    """Return the voxels that a replay with this file and these parameters has."""
    wanted_m = world.voxel_size or None
    points_m, size_m = read_voxel_file(path, wanted_m)
    try:
        return VoxelMap.from_centres(
            points_m, size_m, RigidTransform.identity(), str(path), wanted_m
        )
    except InputError as cause:
        raise MapError(str(cause)) from cause


def _problems(recording: Path, scene: RecordedScene) -> list[str]:
    """Return what was left out, and why the environment is not that of the run."""
    said = [scene.left_out]
    if scene.voxels is None:
        is_missing = walls_of(find_recording(recording).path) == "octomap"
        said.append(scene.cloud_problem or (_WITHOUT_OCTOMAP if is_missing else ""))
    return list(filter(None, said))
