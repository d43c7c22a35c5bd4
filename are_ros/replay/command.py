"""The commands of `are` that read recordings; `say` and `echo` print their text."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.bag.reader import BagReader, recording_in
from are_ros.bag.recording import find_recording
from are_ros.bag.roles import OCTOMAP, named_sensors, read_overrides, sensors_of
from are_ros.builder.assembly import (
    catalogue_of,
    parse_static_transforms,
    replaced_statics,
    robot_footprint,
)
from are_ros.builder.population_manager import scenario_of
from are_ros.builder.sensors.sensor_path import SensorPathCounts
from are_ros.builder.tick import Demand
from are_ros.describe.configuration import describe_lines
from are_ros.describe.site import Site, surveyed
from are_ros.draw.overview import draw_overview
from are_ros.draw.viewer import MISSING_VISER, has_viser, write_view
from are_ros.errors import AreError, MapError, ParameterError
from are_ros.messages.sensors import SENSORS, noun_of
from are_ros.parameters.declaration import flatten, with_values
from are_ros.parameters.model import Parameters, SensorsParameters
from are_ros.parameters.ros_yaml import (
    parse_assignment,
    read_ros_parameters,
    with_file,
    write_ros_parameters,
)
from are_ros.parameters.validation import validated
from are_ros.population.departures import Cause
from are_ros.replay.output_folder import (
    METRICS,
    TIMING,
    VIEW,
    all_or_nothing,
    alone_in,
    animation_path,
    earlier_exports,
    no_empty_folders,
)
from are_ros.replay.pictures import (
    DECISIONS,
    animate,
    place_of,
    plot_decisions,
    plot_population,
)
from are_ros.replay.progress import ProgressBar, Say
from are_ros.replay.results import (
    Content,
    metrics_content,
    summary_lines,
    timing_content,
    write_json,
)
from are_ros.replay.session import Outcome, run_replay
from are_ros.replay.survey.inspection import inspect_bag, inspection_lines
from are_ros.replay.timeline import ReplayOptions
from are_ros.wording import counted, listed
from are_ros.world.map_io import doubt_about_unknown, read_map_file

_SHOWN: Final = 5
_WAIT: Final = "sensors.tf_wait"


def effective_parameters(
    parameter_files: Sequence[Path],
    assignments: Sequence[str],
    seed: int | None,
    map_frame: str | None = None,
    static_transforms: Sequence[str] = (),
    scenario_file: Path | None = None,
    sensors: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> Parameters:
    """Return the parameters of files, assignments and options, each overriding those before it.

    `static_transforms` are added to those of `frames.static`, and replace what these say of the
    same two frames. Raises ParameterError.
    """
    parameters = Parameters()
    for path in parameter_files:
        parameters = with_file(parameters, path)
    parameters = with_values(parameters, dict(parse_assignment(text) for text in assignments))
    options: dict[str, Any] = {}
    if seed is not None:
        options["seed"] = seed
    if map_frame is not None:
        options["frames.map"] = map_frame
    if static_transforms:
        options["frames.static"] = replaced_statics(parameters.frames.static, static_transforms)
    for role, topics in sensors.items():
        if len(topics) > 1 or not SENSORS[role].is_by_role(parameters.sensors):
            options[f"sensors.{SENSORS[role].parameter}"] = tuple(topics)
    if scenario_file is not None:
        options["population.scenario"] = str(scenario_file)
    return validated(with_values(parameters, options))


def is_given(path: str, parameter_files: Sequence[Path], assignments: Sequence[str]) -> bool:
    """Return whether a file or an assignment sets a parameter. Raises ParameterError."""
    in_files = any(path in read_ros_parameters(file) for file in parameter_files)
    return in_files or any(parse_assignment(text)[0] == path for text in assignments)


def options_of(skip: Sequence[str], also: Sequence[str], **options: Any) -> ReplayOptions:
    """Return the options of a replay from those of the command line. Raises AreError."""
    parameters = effective_parameters(
        options["parameter_files"],
        options["assignments"],
        options["seed"],
        options["map_frame"],
        options["static_transforms"],
        options["scenario_file"],
        sensors_of(options["topics"]),
    )
    return ReplayOptions(
        bags=options["bags"],
        parameters=parameters,
        out=options["out"],
        map_file=options["map_file"],
        octomap_file=options["octomap_file"],
        topics=read_overrides(options["topics"]),
        start_s=options["start_s"],
        duration_s=options["duration_s"],
        with_inputs=options["with_inputs"],
        save_scenario=options["save_scenario"],
        demand=Demand(**dict.fromkeys(skip, False), **dict.fromkeys(also, True)),
        is_wait_given=is_given(_WAIT, options["parameter_files"], options["assignments"]),
    )


def replay_command(say: Say, **options: Any) -> bool:
    """Run `are replay`; return False if input was refused or a result could not be written.

    So it does if a scripted artefact could not arrive, or most readings of a topic were not
    augmented; fewer, as before the first transform, and doubts about map and clocks are only said.
    Raises AreError where there is no result.
    """
    replay = options_of(**options)
    wanted = options.get("animate")
    film = None if wanted is None else animation_path(wanted, options["out"])
    scenario = replay.save_scenario
    folders = [options["out"], *([] if scenario is None else [scenario.parent])]
    with no_empty_folders(*folders), alone_in(options["out"]):
        return _replayed_into(options["out"], replay, film, say)


def _replayed_into(out: Path, replay: ReplayOptions, film: Path | None, say: Say) -> bool:
    """Run a replay, and write all its results; return as `replay_command`."""
    said: list[str] = []
    with ProgressBar() as bar:
        outcome = run_replay(replay, say, bar.open)
    with all_or_nothing(out):
        write_results(outcome, out)
    is_filmed = True
    try:
        said += write_replay_view(outcome, out)
        if film is not None:
            threshold = replay.parameters.world.occupied_threshold
            with outcome.stopwatch.phase("animation"):
                animate(outcome.record, outcome.grid, film, threshold, said.append)
    except AreError as cause:
        is_filmed = False
        said.append(str(cause))
    finally:
        timing = timing_content(outcome.record, outcome.stopwatch)
        with all_or_nothing(out):
            write_json(out / TIMING, timing)
        summary = [*summary_lines(_metrics(outcome), timing), f"results in {out}"]
        for line in [*summary, *said, *earlier_exports(out), *complaints(outcome)]:
            say(line)
    in_part = outcome.camera_problem, outcome.cloud_problem, outcome.scan_problem
    problems = outcome.refusals.counts, *in_part, refused_by_script(outcome.record.events)
    return is_filmed and not any(problems) and not any(map(_is_mostly_bare, outcome.scans.values()))


def _is_mostly_bare(scans: SensorPathCounts) -> bool:
    """Return whether most readings of a topic were not augmented."""
    return scans.passed_through > scans.exact + scans.held


def write_results(outcome: Outcome, folder: Path) -> None:
    """Write picture, metrics and effective parameters."""
    parameters = outcome.options.parameters
    with outcome.stopwatch.phase("picture"):
        draw_overview(
            outcome.record,
            outcome.grid,
            folder / "overview.png",
            occupied_threshold=parameters.world.occupied_threshold,
            voxels=outcome.voxels,
        )
    (folder / "effective.yaml").write_text(write_ros_parameters(parameters), encoding="utf-8")
    write_json(folder / METRICS, _metrics(outcome))


def write_replay_view(outcome: Outcome, folder: Path) -> list[str]:
    """Write the page of the viewer, a phase of its own in timing.json; return its sentences.

    Without viser there is no page, and a sentence says what to install. Raises BagError.
    """
    if not has_viser():
        return [MISSING_VISER]
    with outcome.stopwatch.phase("view"):
        parameters, views = outcome.options.parameters, outcome.record.views
        camera = views[-1] if views else None
        place = place_of(parameters, outcome.grid, outcome.voxels, camera)
        title = outcome.options.bags[0].stem
        return [write_view(folder / VIEW, place, outcome.record, title).sentence()]


def _metrics(outcome: Outcome) -> Content:
    readings: dict[str, dict[str, SensorPathCounts]] = {role: {} for role in SENSORS}
    for topic, of_topic in outcome.scans.items():
        readings[outcome.role_of_topic[topic]][topic] = of_topic
    refused, written = outcome.refusals.counts, outcome.messages_written
    has_octomap = outcome.options.octomap_file or OCTOMAP in outcome.role_of_topic.values()
    walls = "octomap" if has_octomap else "map"
    return {**metrics_content(outcome.record, readings, refused, written), "walls": walls}


_OF_READING: Final = ("it ", "its ", "format ", "encoding ")
"""So begins a problem of the reading itself: no transform and no wait mends it."""


def complaints(outcome: Outcome) -> list[str]:
    """Return a sentence for each problem of a replay.

    Problems are refused messages, scans that were not augmented, a camera or a cloud that was not
    used, blocked scripted artefacts, and a map that does not fit the robot's way.
    """
    refusals = outcome.refusals
    lines = [f"refused: {refusals.told(topic)}" for topic in sorted(refusals.counts)]
    for topic, (problem, count) in sorted(outcome.scan_problems.items()):
        role, passed = outcome.role_of_topic[topic], outcome.scans[topic].passed_through
        which = "the last" if count == passed else f"{count} of them alike, the last of these"
        readings = counted(passed, noun_of(role))
        lines.append(f"{topic}: {readings} passed through unaugmented, {which} for: {problem}")
        is_of_reading = problem.startswith(_OF_READING) and "CameraInfo" not in problem
        if is_of_reading or not _is_mostly_bare(outcome.scans[topic]):
            continue
        if topic in outcome.apart or any(name in problem for name in outcome.apart):
            lines[-1] += "; no --static-tf helps: its stamps and those of the transforms differ"
        else:
            is_of_lens = "CameraInfo" in problem
            what = "CameraInfo is missing or of no use" if is_of_lens else "wait is missing"
            lines[-1] += f"; `are inspect` says which --static-tf or which {what}"
    lines += filter(None, [_about_waiting(outcome)])
    if outcome.camera_problem:
        lines.append(f"nothing was perceived: {outcome.camera_problem}")
    lines += filter(None, [outcome.cloud_problem, outcome.scan_problem])
    return [*lines, *refused_by_script(outcome.record.events), *outcome.map_doubts]


def _about_waiting(outcome: Outcome) -> str:
    """Say how long readings wait for their transforms; empty if the default is long enough."""
    waited_s, needed_s = outcome.options.parameters.sensors.tf_wait, outcome.needed_wait_s
    usual_s = SensorsParameters().tf_wait
    if not outcome.options.is_wait_given and waited_s > usual_s:
        return (
            f"the transforms come late: {_WAIT} was {waited_s:g} s, as this recording needs it; "
            f"set it on the robot, too, where readings wait for {usual_s:g} s by default"
        )
    lost = sum(counts.held + counts.passed_through for counts in outcome.scans.values())
    if needed_s > waited_s and lost:
        return (
            f"the transforms come late: {_WAIT} is {waited_s:g} s, but this recording needs "
            f"{needed_s:g} s; a replay for which it is not set waits as long"
        )
    return ""


def refused_by_script(events: Iterable[ArtefactEvent]) -> list[str]:
    """Return a sentence for each of the first scripted artefacts that could not arrive."""
    causes = {cause.value for cause in Cause}
    blocked = (event.detail for event in events if event.kind is EventKind.BLOCKED)
    reasons = [detail for detail in blocked if detail not in causes]
    lines = [f"blocked: {reason}" for reason in reasons[:_SHOWN]]
    if others := reasons[_SHOWN:]:
        lines.append(f"blocked: and {len(others)} more, see blocked_by_cause in {METRICS}")
    return lines


def describe_command(
    echo: Say,
    map_file: Path | None,
    parameter_files: Sequence[Path],
    assignments: Sequence[str],
    seed: int | None,
    plot_path: Path | None = None,
    row: str | None = None,
    *,
    everything: bool = False,
) -> None:
    """Run `are describe`; with a `row` only its decisions, on a map."""
    parameters = effective_parameters(parameter_files, assignments, seed)
    # what is not described is refused all the same, as a replay would
    robot_footprint(parameters.robot)
    parse_static_transforms(parameters.frames.static)
    catalogue, site = catalogue_of(parameters), Site()
    scenario = scenario_of(parameters, catalogue)
    if map_file is not None:
        site = surveyed(read_map_file(map_file, parameters.frames.map), parameters, catalogue)
        if doubt := doubt_about_unknown(map_file):
            echo(doubt)
    if row is not None:
        if site.survey is None:
            raise MapError(f"--decisions {row} needs a map to decide on: give it with --map")
        out = plot_path or Path(DECISIONS)
        path, lines = plot_decisions(parameters, catalogue, site.survey, row, out)
        for line in (*lines, f"picture: {path}"):
            echo(line)
        return
    for line in describe_lines(parameters, catalogue, site, scenario, everything=everything):
        echo(line)
    if plot_path is not None:
        if not scenario.random:
            file = parameters.population.scenario
            raise ParameterError(f"{file} has random: false: no random arrival is there to plot")
        echo(f"\npicture: {plot_population(parameters, catalogue, site, plot_path)}")


def inspect_command(
    echo: Say,
    bags: tuple[Path, ...],
    topics: Sequence[str],
    map_file: Path | None,
    map_frame: str | None,
    static_transforms: Sequence[str],
    parameter_files: Sequence[Path],
    assignments: Sequence[str],
) -> None:
    """Run `are inspect`."""
    of_options = sensors_of(topics)
    parameters = effective_parameters(
        parameter_files, assignments, None, map_frame, static_transforms, sensors=of_options
    )
    with BagReader([recording_in(bag) for bag in bags]) as reader:
        inspection = inspect_bag(
            reader,
            read_overrides(topics),
            parameters=parameters,
            has_map_file=map_file is not None,
            sensors=named_sensors(parameters.sensors) | of_options,
        )
        for sentence in reader.unnamed:
            echo(sentence)
    for line in inspection_lines(inspection, map_file):
        echo(line)


def check_command(
    echo: Say, path: Path, map_file: Path | None, parameters_file: Path | None
) -> bool:
    """Run `are check`; return whether no check failed."""
    from are_ros.checks.result import Outcome as CheckOutcome
    from are_ros.checks.result import want_of_inputs
    from are_ros.checks.run import check_recording

    results = []
    for result in check_recording(path, map_file, parameters_file):
        echo(result.sentence())
        results.append(result)
    if sentence := want_of_inputs(results):
        echo(sentence)
    has_failed = any(result.outcome is CheckOutcome.FAILED for result in results)
    if has_failed and (sentence := other_parameters(path, parameters_file)):
        echo(sentence)
    return not has_failed


def other_parameters(path: Path, given: Path | None) -> str:
    """Say which parameters of a given file are not those of the run, empty if there is none."""
    own = find_recording(path).parameters
    if own is None or given is None:
        return ""
    used, meant = (flatten(with_file(Parameters(), file)) for file in (own, given))
    others = [name for name in used if used[name] != meant[name]]
    names = listed([*others[:_SHOWN], *(["others"] if others[_SHOWN:] else [])])
    return f"{given} differs from the run's own {own} in {names}: check without it" if names else ""
