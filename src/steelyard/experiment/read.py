"""From an experiment file and its logs to an :class:`Experiment`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from steelyard.display import printable
from steelyard.experiment.checks import (
    check_carried,
    check_described,
    check_known_or_weighed,
    check_length_noise,
    check_moves_within,
    check_run,
)
from steelyard.experiment.form import (
    ExperimentForm,
    PlanForm,
)
from steelyard.experiment.loads import (
    known_values,
    loads_of_forms,
    mass_walk,
)
from steelyard.experiment.model import Datum, Experiment
from steelyard.experiment.read_run import read_run
from steelyard.experiment.recording import Run
from steelyard.experiment.tables.dead_weights import with_weights_apart
from steelyard.experiment.tables.seen_frequencies import with_frequencies_apart
from steelyard.experiment.unread import with_unread_cables
from steelyard.files.document import YamlDocument, require_printable
from steelyard.files.file_model import validate
from steelyard.files.yaml_file import read_yaml
from steelyard.logs.log import Log
from steelyard.processes.forked import check_not_forked
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot


def read_experiment(path: str | Path, *, weighed: bool = True) -> Experiment:
    """Read an experiment file with all its streams.

    Args:
        path: The file; streams and robot file stand relative to it.
        weighed: Whether a body is to be told by forces; else runs need none, and only what is
            stated of the robot's uncertainty counts: for its calibration.

    Raises:
        InputError: Anything that does not fit the contract; the sentence says where and what to do.
        SteelyardError: This process was forked from one that had read recordings.
    """
    check_not_forked()
    path = Path(path)
    document = read_yaml(path)
    require_printable(document)
    form = validate(ExperimentForm, document)
    robot = read_robot(form.robot, document.path.parent)
    experiment = assembled(form, robot, document, {}, weighed=weighed)
    # The name of a folder may be bytes that are no text.
    folder = printable(os.fsencode(path.parent.resolve().name).decode(errors="replace"))
    experiment = replace(experiment, name=form.name or folder, source=str(path))
    return experiment if weighed else _as_stated(experiment, form)


def assembled(
    form: ExperimentForm,
    robot: Robot,
    document: YamlDocument,
    logs: Mapping[str, Log],
    *,
    weighed: bool,
) -> Experiment:
    """The experiment that a form describes, once everything about it has been looked at.

    Args:
        form: What is said of instruments and runs.
        robot: That they were recorded on.
        document: Where the form comes from; logs stand beside it.
        logs: File of a stream -> log, where it is in memory.
        weighed: See :func:`read_experiment`.

    Raises:
        InputError: Anything that does not fit the contract.
    """
    check_described(form, robot, document)
    check_carried(form, document)
    check_length_noise(form, document)
    runs = tuple(read_run(i, run, form, robot, document, logs) for i, run in enumerate(form.runs))
    listed = _experiment(form, robot, runs)
    experiment = with_unread_cables(with_weights_apart(with_frequencies_apart(listed)))
    if experiment.weights and not (experiment.runs or experiment.frequencies):
        raise document.error(
            ("runs",),
            "expected a run of the platform beside the dead weights, found none; add one",
        )
    if weighed:
        check_known_or_weighed(experiment, document)
    numbers = {run.name: i for i, run in enumerate(runs)}
    for run in experiment.runs:
        if weighed:
            check_moves_within(experiment, run, document, ("runs", numbers[run.name]))
        check_run(experiment, run, document, ("runs", numbers[run.name]), weighed=weighed)
    return experiment


def _as_stated(experiment: Experiment, form: ExperimentForm) -> Experiment:
    """The experiment with only what is stated of the robot's uncertainty."""
    stated = form.uncertainty.model_fields_set
    kept = {key: v for key, v in experiment.uncertainty.items() if key in stated}
    return replace(experiment, uncertainty=kept)


def read_plan(path: str | Path, *, weighed: bool = True) -> Experiment:
    """Read what an experiment file says of robot and instruments, recorded or not.

    Recordings are looked at only where an instrument states no rate and they have to show it.

    Args:
        path: The file.
        weighed: Whether a body is to be told by forces; else it is for a calibration, as in
            :func:`read_experiment`, and poses at rest need no rate.

    Raises:
        InputError: Anything that does not fit the contract; the sentence says where and what to do.
    """
    path = Path(path)
    document = read_yaml(path)
    require_printable(document)
    form = validate(PlanForm, document)
    if not weighed:
        return _as_stated(_planned(form, document), form)
    if form.runs and any(
        i.rate is None and not (i.commanded or i.tabular) for i in form.instruments.values()
    ):
        return read_experiment(path)
    listed = _planned(form, document)
    return with_weights_apart(with_frequencies_apart(listed))


def _planned(form: PlanForm, document: YamlDocument) -> Experiment:
    """Robot and instruments without recordings."""
    robot = read_robot(form.robot, document.path.parent)
    check_described(form, robot, document)
    folder = os.fsencode(document.path.parent.resolve().name).decode(errors="replace")
    name, source = form.name or folder, str(document.path)
    return replace(_experiment(form, robot, ()), name=name, source=source)


def _experiment(form: ExperimentForm, robot: Robot, runs: tuple[Run, ...]) -> Experiment:
    """The experiment, once all of its parts are read."""
    loads = loads_of_forms(form.loads, robot.platform)
    if loads:
        robot = replace(robot, platform=loads[0].nominal)
    return Experiment(
        name=form.name or "experiment",
        robot=robot,
        instruments=form.instruments,
        runs=runs,
        known=loads[0].known if loads else known_values(form.known),
        mass_walk=mass_walk(form.known),
        loads=loads,
        uncertainty=form.uncertainty.of_robot,
        length_noise=form.uncertainty.length_noise,
        surroundings=form.surroundings,
        datum=None if form.datum is None else Datum(form.datum.anchors or (), form.datum.pose),
    )
