"""Which topics of a bag to use: whose scans, and which of the poses that it holds.

Scans: those of the topics named, else of every laser that is known to sit on one robot
(`scan_topics`). Poses: of the source named, else of whatever covers the scans best
(`pose_choice`); in a bag with several robots those of the robot with the first laser. Every
choice is said in a line, with what else was there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ogm_mcmc.config.pose_sources import POSE_SOURCES
from ogm_mcmc.engine.bag_survey import (
    BagSurvey,
    SeenTopic,
    survey,
    transform_topics,
)
from ogm_mcmc.engine.odometry import odometry_among
from ogm_mcmc.engine.pose_choice import (
    FILE,
    TF,
    PoseCandidate,
    RankedPoses,
    choose_poses,
    tf_candidates,
)
from ogm_mcmc.engine.pose_motion import choose_robot_poses
from ogm_mcmc.engine.recorded_poses import filled_in
from ogm_mcmc.engine.scan_topics import (
    POSE_TYPES,
    lasers_of,
    reading_topics,
    robot_of,
    robots_of,
)
from ogm_mcmc.engine.stream_choice import StreamChoice, StreamTopics
from ogm_mcmc.engine.tf_poses import TfFrames, guess_frames
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import BagError
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.tf_messages import TF_TYPES
from ogm_mcmc.io.trajectory_files import Trajectory, read_trajectory, with_ends_held
from ogm_mcmc.io.tum_files import deviations_file, read_deviations

__all__ = ['choose_topics', 'said_unstamped']

BASE_FRAME = 'base_link'


def choose_topics(bag: BagReader, choice: StreamChoice) -> StreamTopics:
    """Choose scans and poses of a bag. Raises BagError that says what is missing."""
    readings = reading_topics(bag, choice)
    first = readings[0]
    others = robots_of(bag) - {robot_of(first.name)}
    mine = [t for t in bag.topics() if t.n_messages and robot_of(t.name) not in others]
    named = bool(choice.scan_topic)
    if not named:
        readings = [topic for topic in readings if robot_of(topic.name) not in others]
    tf = transform_topics((t for t in mine if t.msgtype in TF_TYPES), first.name)
    tf = [topic for topic in tf if not bag.problem(topic.name)]
    posed = [t for t in mine if t.msgtype in POSE_TYPES and not bag.problem(t.name)]
    if choice.pose_topic:
        named_pose = bag.find('poses', _types(choice.pose_source), choice.pose_topic)
        wheels = [t for t in posed if t.msgtype == ros_types.ODOMETRY and t != named_pose]
        choice, posed = replace(choice, pose_topic=named_pose.name), [named_pose, *wheels]
    seen = survey(bag, [*readings, *posed], tf)
    found = [seen.topics[topic.name] for topic in readings if topic.name in seen.topics]
    if not found:
        raise BagError(f'{bag.path}: no message on {first.name}, although its index names some')
    frames = _frames(seen.tree, found[0].frame, choice)
    scans: list[SeenTopic] = found
    remarks: list[str] = []
    if choice.sensor == 'scan' and not named:
        scans, remarks = lasers_of(found, seen.tree, frames.base_frame, choice.mounts)
    if others and not named:
        robot = robot_of(first.name) or 'the one without a namespace'
        line = f'scans of robot {robot}; also there: {", ".join(sorted(others))} (--scan-topic)'
        remarks = [line, *remarks]
    return _with_poses(bag, choice, scans, seen, frames, remarks)


def _with_poses(
    bag: BagReader,
    choice: StreamChoice,
    scans: list[SeenTopic],
    seen: BagSurvey,
    frames: TfFrames,
    remarks: list[str],
) -> StreamTopics:
    stamps = np.concatenate([topic.stamps for topic in scans])
    candidates = _candidates(seen, frames, [topic.topic.name for topic in scans])
    trajectory: Trajectory | None = None
    moved_by: RankedPoses | None = None
    if choice.trajectory is not None:
        source, trajectory, moved_by = _of_file(bag, choice, scans, seen, frames, candidates)
        wanted = [source]
    else:
        wanted = [one for one in candidates if _is_wanted(one, choice)]
        candidates = [one for one in candidates if not _is_wanted(one, choice)]
    if not wanted:
        raise BagError(_no_poses(bag, choice, seen, scans[0], candidates))
    poses, strays = choose_robot_poses(
        bag,
        seen.tree,
        stamps,
        wanted,
        unwanted=candidates,
        max_gap_s=choice.max_pose_gap_s,
        named=choice.pose_topic != '' or choice.pose_source != 'auto',
    )
    if poses.chosen is None:
        raise BagError(f'{bag.path}: {poses}')
    source = poses.chosen.candidate
    remarks += [str(poses), *strays]
    if moved_by is not None:
        remarks.append(f'between poses of {source.name} motion is that of {moved_by}')
    if trajectory is not None and trajectory.deviations is not None:
        assert choice.trajectory is not None
        remarks.append(
            f'standard deviations of its poses from {deviations_file(choice.trajectory).name}'
        )
    if rare := poses.rarely():
        remarks.append(rare)
    used = {source.name, *(topic.topic.name for topic in scans)}
    unstamped = sorted(n for n, one in seen.topics.items() if one.unstamped and n in used)
    still = [*unstamped]
    if moved_by is not None and moved_by.candidate.unstamped:
        still.append(moved_by.candidate.name)
    if still:
        remarks.append(said_unstamped(still))
    unstamped_frames = _unstamped_above(seen, scans, frames.base_frame)
    if unstamped_frames:
        remarks.append(
            f'stamps of transforms to {", ".join(unstamped_frames)} are all 0 or all the same: '
            'the times of recording are taken'
        )
    return StreamTopics(
        tuple(topic.topic for topic in scans),
        poses,
        _source_of(source),
        source.frame,
        _posed_frame(seen.tree, source, scans[0].frame, frames.base_frame),
        seen.tree,
        trajectory,
        tuple(remarks),
        tuple(sensor for one in scans for sensor in zip(one.frames, one.middle_ns, strict=True)),
        frozenset(unstamped),
        moved_by is not None,
        tuple(record for one in scans for record in one.sampled),
        unstamped_frames,
    )


def said_unstamped(topics: Sequence[str]) -> str:
    """Return a line for the user about topics whose clocks stand still."""
    names = ', '.join(topics)
    return f'stamps on {names} are all 0 or all the same: the times of recording are taken'


def _unstamped_above(seen: BagSurvey, scans: list[SeenTopic], base: str) -> tuple[str, ...]:
    """Return the frames without stamps that say where sensors and base are."""
    below = {base}.union(*(scan.frames for scan in scans))
    above = {one for frame in below for one in seen.tree.ancestors(frame)}
    return tuple(frame for frame in seen.unstamped_frames if frame in above)


# -- poses ----------------------------------------------------------------------------------


def _of_file(
    bag: BagReader,
    choice: StreamChoice,
    scans: list[SeenTopic],
    seen: BagSurvey,
    frames: TfFrames,
    candidates: list[PoseCandidate],
) -> tuple[PoseCandidate, Trajectory, RankedPoses | None]:
    """Return the poses of a trajectory file, and what odometry they were filled in by, if any."""
    assert choice.trajectory is not None
    trajectory = read_trajectory(choice.trajectory, choice.trajectory_stamps)
    if choice.beliefs and choice.deviations:
        spread = read_deviations(choice.trajectory, trajectory.stamps_ns, apart=True)
        trajectory = trajectory._replace(deviations=spread)
    frame = choice.trajectory_frame or frames.base_frame
    source = PoseCandidate(choice.trajectory.name, FILE, 'map', frame, ())
    base = _posed_frame(seen.tree, source, scans[0].frame, frames.base_frame)
    stamps = np.concatenate([topic.stamps for topic in scans])
    beside = choose_poses((), stamps, max_gap_s=choice.max_pose_gap_s, unwanted=candidates)
    moved_by: RankedPoses | None = None
    if (found := odometry_among(beside, base, seen.tree)) is not None:
        filled = filled_in(bag, seen.tree, trajectory, found.candidate, choice.limits)
        if filled is not None:
            trajectory, moved_by = filled, found
    # Last: poses held beside their own would tell of each other what odometry is judged by.
    trajectory = with_ends_held(trajectory)
    return source._replace(stamps=(trajectory.stamps_ns,)), trajectory, moved_by


def _frames(tree: TransformTree, scan_frame: str, choice: StreamChoice) -> TfFrames:
    """Return the frames of map and base above a sensor; the map's is empty where none is."""
    found = guess_frames(
        tree, scan_frame, map_frame=choice.map_frame, base_frame=choice.base_frame
    )
    if found is not None:
        return found
    chain = tree.ancestors(scan_frame)
    base = choice.base_frame or (chain[-1] if len(chain) > 1 else BASE_FRAME)
    return TfFrames('', base)


def _candidates(seen: BagSurvey, frames: TfFrames, scans: Sequence[str]) -> list[PoseCandidate]:
    base, tree = frames.base_frame, seen.tree
    by_tf = tf_candidates(tree, base)
    posed = {one.frame for one in by_tf}
    found = [
        PoseCandidate(
            name,
            one.topic.msgtype,
            one.frame,
            one.child_frame,
            (one.stamps,),
            unstamped=one.unstamped,
        )
        for name, one in seen.topics.items()
        # What is said in the frame of the robot is no place of the robot.
        if name not in scans
        and one.topic.msgtype in POSE_TYPES
        and (one.frame in posed or base not in tree.ancestors(one.frame))
    ]
    return found + by_tf


def _is_wanted(one: PoseCandidate, choice: StreamChoice) -> bool:
    if choice.pose_topic:
        return one.kind != TF and one.name == choice.pose_topic
    if one.kind == TF and choice.map_frame not in ('', one.frame):
        return False
    if choice.pose_source in ('auto', TF):
        return choice.pose_source == 'auto' or one.kind == TF
    return one.kind in POSE_SOURCES[choice.pose_source]


def _types(pose_source: str) -> tuple[str, ...]:
    return POSE_TYPES if pose_source == 'auto' else POSE_SOURCES[pose_source]


def _source_of(one: PoseCandidate) -> str:
    if one.kind == FILE:
        return 'trajectory'
    return next(name for name, kinds in POSE_SOURCES.items() if one.kind in (name, *kinds))


def _how_to_take(one: PoseCandidate, choice: StreamChoice) -> str:
    if one.kind == TF and choice.pose_source in ('auto', TF):
        return f'tf {one.frame} -> {one.child_frame} (--map-frame {one.frame})'
    return f'{one.name} (--pose-source {_source_of(one)})'


def _posed_frame(tree: TransformTree, source: PoseCandidate, sensor: str, base: str) -> str:
    """Return the frame that poses are of: the child they name, where tf knows it."""
    child = source.child_frame
    if not child or source.kind == TF:
        return base
    unknown = child != sensor and tree.newest_common_ns(child, sensor) is None
    return base if unknown and tree.frames() else child


def _no_poses(
    bag: BagReader,
    choice: StreamChoice,
    seen: BagSurvey,
    scan: SeenTopic,
    candidates: list[PoseCandidate],
) -> str:
    """Say what was looked for, why tf does not help, and what is there."""
    tree = seen.tree
    expected = ' or '.join(_types(choice.pose_source))
    line = f'{bag.path}: no poses in it: expected {expected}'
    line += ' or tf' if choice.pose_source == 'auto' else ''
    if tree.frames() and choice.pose_source in ('auto', TF):
        named = {'map_frame': choice.map_frame, 'base_frame': choice.base_frame}
        missing = [name for name, frame in named.items() if frame and frame not in tree.frames()]
        if missing:
            frames = ' and '.join(f'{named[name]!r} ({name})' for name in missing)
            line += f'; frame {frames} is not in its transforms ({tree})'
        elif scan.frame in tree.frames():
            line += f'; nothing moves above frame {scan.frame!r} in its transforms ({tree})'
        else:
            line += (
                f'; frame {scan.frame!r} of {scan.topic.name} is not in its transforms ({tree})'
            )
    if candidates:
        there = {_how_to_take(one, choice) for one in candidates}
        return f'{line}; there are {", ".join(sorted(there))}'
    held = ', '.join(map(str, bag.topics()))
    on_robot = [
        f'those of {name} are in {one.frame!r}, a frame of the robot'
        for name, one in seen.topics.items()
        if one.topic.msgtype in POSE_TYPES
    ]
    return '; '.join([line, *on_robot, f'it holds {held}'])
