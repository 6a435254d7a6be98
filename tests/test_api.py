"""The Python face: three lines a verb, values that show themselves, frames of Polars and pandas."""

import html
import inspect as python_inspect
import subprocess
import sys
import types
import typing
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import polars as pl
import pytest
from recordings import DURATION, RUN, simulated, write_small
from scipy.spatial.transform import Rotation

import steelyard
from steelyard.errors import SteelyardError
from steelyard.estimates.estimate import Estimate, Verdict, judge
from steelyard.excitation.information.optimality_criterion import Target
from steelyard.excitation.plan import planned
from steelyard.identification.chosen_methods import AVAILABLE, chosen_methods
from steelyard.identification.identification import Identification
from steelyard.identification.model.fitted_motion import QUANTITIES, FittedMotion
from steelyard.inertia import BODY_PARAMETERS

BODY = steelyard.Inertia(
    161.058, np.array([-0.001, -0.077, -0.118]), np.diag([94.955, 88.859, 31.635])
)
SIGMA = np.array([0.38, 1.66e-3, 1.26e-3, 2.26e-3, 0.48, 0.6, 0.6, 0.4, 0.37, 0.29])


def estimated(method="consistent", value=BODY.body_parameters, **keys):
    return Estimate(method, value, np.diag(SIGMA**2), keys.pop("verdict", judge(value)), **keys)


@pytest.fixture
def half_told():
    value = BODY.body_parameters.copy()
    value[7:] = np.nan
    covariance = np.diag(np.where(np.isnan(value), np.nan, SIGMA**2))
    labels = (
        dict.fromkeys(BODY_PARAMETERS, "data")
        | {"mass": "prior"}
        | dict.fromkeys(BODY_PARAMETERS[7:], "unidentifiable")
    )
    verdict = Verdict(False, ("the residual drifts", "<b>\x1b[31m & more"), labels)
    return Estimate("least-squares", value, covariance, verdict, notes=("one", "two"))


# What values show


def test_an_estimate_shows_itself():
    assert (
        repr(estimated())
        == """\
consistent: accepted
mass                 kg     161.06 ± 0.38
centre of gravity x  mm        -1.0 ± 1.7
centre of gravity y  mm       -77.0 ± 1.3
centre of gravity z  mm      -118.0 ± 2.3
inertia xx           kg m²   94.95 ± 0.48
inertia yy           kg m²   88.86 ± 0.60
inertia zz           kg m²   31.64 ± 0.60
inertia yz           kg m²    0.00 ± 0.40
inertia xz           kg m²    0.00 ± 0.37
inertia xy           kg m²    0.00 ± 0.29"""
    )


def test_what_is_not_told_by_the_data_is_labelled_and_reasons_are_given(half_told):
    lines = repr(half_told).splitlines()
    assert lines[0] == "least-squares: not accepted"
    assert lines[1].split() == ["mass", "kg", "161.06", "±", "0.38", "prior"]
    assert lines[5].split() == ["inertia", "xx", "kg", "m²", "94.95", "±", "0.48"]
    assert lines[8].split() == ["inertia", "yz", "kg", "m²", "-", "unidentifiable"]
    assert lines[11:] == [
        "the residual drifts",
        "<b>\N{REPLACEMENT CHARACTER}[31m & more",
        "notes: 2",
    ]


def test_an_identification_shows_all_methods(half_told):
    found = Identification(
        "two <methods>", None, {"least-squares": half_told, "consistent": estimated()}
    )
    lines = repr(found).splitlines()
    assert lines[0] == "two <methods>"
    assert lines[1].split() == ["least-squares", "consistent"]
    assert lines[2].split() == ["mass", "kg", "161.06", "±", "0.38", "161.06", "±", "0.38"]
    assert lines[-1] == "consistent: accepted"
    assert lines[-2].startswith("least-squares: not accepted: the residual drifts; ")
    assert found.estimate is found.estimates["consistent"]


class Text(HTMLParser):
    """Tags and text of a piece of HTML; tags must close in order."""

    def __init__(self, source):
        super().__init__()
        self.tags, self.open, self.text = [], [], []
        self.feed(source)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_html_says_the_same_and_is_escaped(half_told):
    found = Identification(
        "two <methods>", None, {"least-squares": half_told, "consistent": estimated()}
    )
    for shown in (half_told, found):
        source = shown._repr_html_()
        read = Text(source)
        assert set(read.tags) <= {"div", "table", "caption", "thead", "tbody", "tr", "th", "td"}
        assert "<b>" not in source
        assert "\x1b" not in source
        assert "color" not in source
        words = [" ".join(line.split()) for line in repr(shown).splitlines()]
        assert " ".join(" ".join(read.text).split()) == " ".join(words)
        assert html.escape("<b>") in source


def test_a_body_and_a_robot_show_themselves():
    assert (
        repr(BODY)
        == "Inertia: 161.058 kg at (-1, -77, -118) mm, xx 94.955, yy 88.859, zz 31.635, yz 0, xz 0,"
        " xy 0 kg m²"
    )
    robot = steelyard.read_robot("cogiro")
    assert repr(robot) == "Robot 'cogiro': 8 cables, nominal platform 161.058 kg"
    bare = replace(
        robot,
        name="\x1b[2J",
        anchors=np.zeros((0, 3)),
        attachments=np.zeros((0, 3)),
        platform=None,
        pulley_radius=[],
        pulley_axis=[],
    )
    assert repr(bare) == "Robot '\N{REPLACEMENT CHARACTER}[2J': no cables, no nominal platform"


def test_an_experiment_shows_itself():
    experiment = simulated()
    run = experiment.runs[0]
    lines = repr(experiment).splitlines()
    assert lines[0] == f"Experiment '{experiment.name}' on {experiment.robot!r}"
    assert lines[1] == "  cables (tension), imu (imu), tracker (position), command (command)"
    assert lines[2] == f"  {run!r}"
    assert f"tracker {len(run.streams['tracker'])}" in lines[2]
    stream = run.streams["cables"]
    assert repr(stream).startswith(
        f"Stream: {len(stream)} samples from {stream.time[0]:.2f} to {stream.time[-1]:.2f} s, 25 Hz"
    )
    assert len(repr(replace(experiment, runs=experiment.runs * 40)).splitlines()) < 20


# Frames


def same(polars, pandas, columns):
    assert list(polars.columns) == list(pandas.columns) == list(columns)
    for name, wanted in columns.items():
        if np.asarray(wanted).dtype.kind == "f":
            np.testing.assert_array_equal(polars[name].to_numpy(), wanted)
            np.testing.assert_array_equal(pandas[name].to_numpy(), wanted)
            assert polars[name].null_count() == np.isnan(wanted).sum()
        else:
            assert polars[name].to_list() == pandas[name].to_list() == list(wanted)


def test_an_estimate_as_a_frame(half_told):
    frame, other = half_told.to_polars(), half_told.to_pandas()
    same(frame, other, half_told.columns())
    assert frame["parameter"].to_list() == list(BODY_PARAMETERS)
    assert frame["unit"].to_list() == ["kg", "m", "m", "m"] + ["kg m^2"] * 6
    np.testing.assert_array_equal(frame["value"].to_numpy(), half_told.value)
    np.testing.assert_array_equal(other["sigma"], half_told.standard_deviation)
    assert frame["label"].to_list()[:2] == ["prior", "data"]
    assert isinstance(frame, pl.DataFrame)
    assert isinstance(other, pd.DataFrame)
    # A frame is the user's own: changing it changes no estimate.
    other.loc[0, "value"] = 0.0
    assert half_told.mass == BODY.mass


def test_an_identification_as_a_long_frame(half_told):
    found = Identification("two", None, {"least-squares": half_told, "consistent": estimated()})
    frame = found.to_polars()
    same(frame, found.to_pandas(), found.columns())
    assert frame["method"].to_list() == ["least-squares"] * 10 + ["consistent"] * 10
    own = frame.filter(pl.col("method") == "consistent").drop("method")
    assert own.equals(found.estimate.to_polars())


def test_streams_as_frames(tmp_path):
    experiment = simulated()
    run = experiment.runs[0]
    written = write_small(tmp_path).parent / RUN
    for name in ("cables", "imu", "tracker"):
        frame = experiment.to_polars(RUN, name)
        same(frame, experiment.to_pandas(RUN, name), experiment.columns(RUN, name))
        # The columns of the file, which the reader reads.
        assert frame.equals(pl.read_csv(written / f"{name}.csv"))
    np.testing.assert_array_equal(
        experiment.to_polars(RUN, "cables").drop("t").to_numpy(),
        run.streams["cables"].values["tension"],
    )
    quaternion = experiment.to_polars(RUN, "imu").select("qw", "qx", "qy", "qz").to_numpy()
    turned = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(turned, run.streams["imu"].values["orientation"], atol=1e-12)
    shifted = experiment.to_polars(RUN, "tracker", clock="common")["t"].to_numpy()
    np.testing.assert_allclose(
        shifted, run.streams["tracker"].time - run.sync["tracker"], atol=1e-9
    )


def test_poses_have_no_time(examples):
    poses = steelyard.read_experiment(examples / "kuka-tool" / "experiment.yaml").to_polars(
        "poses", "wrench"
    )
    assert poses.columns == ["fx", "fy", "fz", "tx", "ty", "tz"]
    assert len(poses) == 24


def test_what_is_not_there_is_named():
    with pytest.raises(
        SteelyardError, match="run: expected one of moving, found 'still'; choose one of these"
    ):
        simulated().to_polars("still", "imu")
    with pytest.raises(
        SteelyardError,
        match="run 'moving': expected one of cables, imu, tracker, command, found 'eye'",
    ):
        simulated().to_pandas(RUN, "eye")


def test_a_fitted_motion_as_a_frame(rng):
    values = {name: rng.normal(size=(5, 3)) for name in QUANTITIES}
    motion = FittedMotion(
        "a",
        np.arange(5.0),
        rng.normal(size=(5, 4)),
        {k: v for k, v in values.items() if k != "rotation"},
        values,
    )
    same(motion.to_polars(), motion.to_pandas(), motion.columns())
    assert repr(motion) == "FittedMotion of run 'a': 5 instants from 0.00 to 4.00 s"


def test_without_pandas_one_sentence_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(
        SteelyardError,
        match=(
            r"expected the package pandas, found none installed; pip install 'steelyard\[pandas\]'"
        ),
    ):
        estimated().to_pandas()
    assert len(estimated().to_polars()) == 10


# Named values


def test_the_ten_by_name(half_told):
    whole = estimated()
    assert whole.mass == BODY.mass
    np.testing.assert_array_equal(whole.center_of_gravity, BODY.center_of_gravity)
    np.testing.assert_array_equal(whole.inertia, BODY.inertia)
    np.testing.assert_array_equal(np.isnan(half_told.inertia), ~np.eye(3, dtype=bool))


# Verbs in three lines


def test_methods_by_name():
    assert [m.name for m in chosen_methods([])] == ["two-step", "maximum-likelihood"]
    assert [m.name for m in chosen_methods(["all"])] == list(AVAILABLE)
    assert [m.name for m in chosen_methods(["consistent", "consistent"])] == ["consistent"]
    own = steelyard.TwoStep(acceleration="tracker")
    assert chosen_methods([own, "least-squares"])[0] is own
    assert chosen_methods(["all"], {"two-step": own})[0] is own
    with pytest.raises(
        SteelyardError,
        match=r"expected one of two-step, .*, or all, found 'best'; choose one of these",
    ):
        chosen_methods(["best"])


@pytest.mark.slow
@pytest.mark.integration
def test_read_identify_show(tmp_path):
    experiment = steelyard.read_experiment(str(write_small(tmp_path)))
    found = steelyard.identify(experiment, "least-squares")
    assert repr(found.estimate).startswith("least-squares: ")
    again = steelyard.identify(experiment, [steelyard.LeastSquares()])
    np.testing.assert_array_equal(found.estimate.value, again.estimate.value)


@pytest.mark.integration
def test_simulate_and_write(tmp_path):
    virtual = steelyard.simulate("cogiro", duration=DURATION, seed=3)
    robot = steelyard.read_robot("cogiro")
    same_again = steelyard.simulate(
        robot,
        steelyard.trajectories(robot, "multisine", DURATION),
        steelyard.read_sensors("paper", robot),
        seed=3,
    )
    for name, stream in virtual.experiment.runs[0].streams.items():
        np.testing.assert_array_equal(stream.time, same_again.experiment.runs[0].streams[name].time)
    assert repr(virtual).splitlines()[-1] == f"  truth: {robot.platform!r}"
    virtual.write(tmp_path / "made")
    read = steelyard.read_experiment(tmp_path / "made" / "experiment.yaml")
    assert read.to_polars("multisine", "tracker").equals(
        virtual.experiment.to_polars("multisine", "tracker")
    )
    assert (tmp_path / "made" / "truth.json").is_file()
    with pytest.raises(SteelyardError, match="made"):
        virtual.write(tmp_path / "made")
    with pytest.raises(
        SteelyardError, match="duration: expected none with trajectories, found one"
    ):
        steelyard.simulate(robot, {}, duration=3.0)


def test_what_a_design_is_for_may_be_named(examples):
    robot = steelyard.read_robot("cogiro")
    by_name, by_value = planned("cogiro"), planned(robot, steelyard.read_sensors("paper", robot))
    assert by_name.instruments == by_value.instruments
    np.testing.assert_array_equal(by_name.robot.anchors, robot.anchors)
    assert planned(by_value, "ideal") is by_value
    assert planned(str(examples / "kuka-tool" / "experiment.yaml")).name == "tool on a KUKA wrist"
    with pytest.raises(SteelyardError, match="expected the path of a robot file"):
        steelyard.design("nothing", duration=10)


def test_a_design_shows_itself():
    sigma = np.where(np.arange(10) == 3, np.nan, SIGMA)
    appraisal = SimpleNamespace(
        experiment=SimpleNamespace(robot=steelyard.read_robot("cogiro")),
        trajectories={"design": SimpleNamespace(duration=10.0)},
        standard_deviation=sigma,
        target=Target.default(BODY),
        worst=("cz", np.inf),
        verified={"design": SimpleNamespace(violations=("too fast",))},
    )
    design = steelyard.Design(appraisal, (), 0, True)
    lines = repr(design).splitlines()
    assert lines[0] == "Design for cogiro: 'design' of 10 s"
    assert lines[1].split() == ["1-sigma", "wanted"]
    assert lines[2].split() == ["mass", "kg", "0.38", "1.6"]
    assert lines[5].split() == ["centre", "of", "gravity", "z", "mm", "not", "identifiable", "2.0"]
    assert lines[-2:] == ["worst: cz, not identifiable", "too fast"]
    assert design.trajectories is appraisal.trajectories
    Text(design._repr_html_())


def test_compare_and_payload():
    heavier = estimated(
        value=steelyard.Inertia.from_parameters(
            BODY.parameters
            + steelyard.Inertia(20.0, np.array([0.3, 0, 0.2]), np.diag([2.0, 2.0, 1.0])).parameters
        ).body_parameters
    )
    comparison = steelyard.compare({"monday": estimated(), "tuesday": heavier})
    assert "tuesday, compared with monday" in repr(comparison)
    assert str(comparison.pairs[0].agreement) in repr(comparison)
    Text(comparison._repr_html_())
    added = steelyard.payload(estimated(), heavier)
    assert added.estimate.mass == pytest.approx(20.0)
    np.testing.assert_allclose(added.estimate.center_of_gravity, [0.3, 0, 0.2], atol=1e-9)
    lines = repr(added).splitlines()
    assert lines[0] == "added between before and after, by difference: accepted"
    assert lines[1].split() == ["mass", "kg", "20.00", "±", "0.54"]


@pytest.mark.integration
def test_an_inspection_is_short():
    text = repr(steelyard.inspect(simulated()))
    assert text.startswith(f"Inspection of '{simulated().name}': no mistakes, no contacts")


def test_import_by_path(recordings):
    folder = recordings / "caspr" / "CoGiRo"
    imported = steelyard.import_robot(
        [str(folder / "CoGiRo_bodies.xml"), folder / "CoGiRo_cables.xml"]
    )
    assert repr(imported).startswith(repr(imported.robot))


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: steelyard.design("cogiro", "x"), "duration: expected a finite number, found 'x'"),
        (lambda: steelyard.design("cogiro", float("nan")), "duration: expected a finite number"),
        (lambda: steelyard.design(None, 5), "robot 'None'"),
        (lambda: steelyard.design("cogiro", 5, sensors=3), "sensors: expected Sensors"),
        (lambda: steelyard.design("cogiro", 5, runs=0), "runs: expected a whole number"),
        (lambda: steelyard.design("cogiro", 5, seed=-1), "seed: expected a whole number"),
        (lambda: steelyard.design("cogiro", 5, margin="wide"), "margin: expected a finite number"),
        (lambda: steelyard.design("cogiro", 5, target=[1]), "target: expected a Target"),
        (lambda: steelyard.design("cogiro", 5, start=[0, 0, 2]), "start: expected shape 6"),
        (lambda: steelyard.design("cogiro", 5, end="up"), "end: expected numbers"),
        (lambda: steelyard.design_poses("cogiro", 2.5), "poses: expected a whole number"),
        (
            lambda: steelyard.design_swings("cogiro", 2, duration=None),
            "duration: expected a finite",
        ),
        (lambda: steelyard.design_references("cogiro", sigma="x"), "expected a finite number"),
        (lambda: steelyard.simulate("cogiro", 3), "trajectories: expected a mapping"),
        (lambda: steelyard.simulate("cogiro", seed=None), "seed: expected a whole number"),
        (lambda: steelyard.simulate("cogiro", duration=[1]), "duration: expected a finite number"),
        (lambda: steelyard.study("cogiro", "out", draws="ten"), "draws: expected a whole number"),
        (lambda: steelyard.compare(["a.json", "b.json"]), "estimates: expected named estimates"),
        (lambda: steelyard.compare("a.json"), "estimates: expected named estimates"),
        (lambda: steelyard.payload("a.json", "b.json"), "before: expected an estimate"),
    ],
)
def test_what_is_handed_over_is_refused_in_words_of_python(call, says):
    with pytest.raises(steelyard.InputError) as raised:
        call()
    assert says in str(raised.value)
    assert "--" not in str(raised.value)


# The face itself


def public():
    return [(name, getattr(steelyard, name)) for name in steelyard.__all__]


def test_names_are_sorted_and_listed():
    assert steelyard.__all__ == sorted(steelyard.__all__)
    assert set(dir(steelyard)) == set(steelyard.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'weigh'"):
        steelyard.weigh  # noqa: B018


def members(value):
    if not python_inspect.isclass(value):
        return
    for name, member in vars(value).items():
        if not name.startswith("_") and value.__module__.startswith("steelyard"):
            function = (
                member.fget if isinstance(member, property) else getattr(member, "__func__", member)
            )
            if isinstance(function, types.FunctionType):
                yield f"{value.__name__}.{name}", function


@pytest.mark.parametrize(("name", "value"), public(), ids=lambda v: v if isinstance(v, str) else "")
def test_all_is_documented_and_typed(name, value):
    # Frames are annotated with packages that load when they are wanted.
    lazy = {"pl": pl, "pd": pd, "go": go}
    for where, each in [(name, value), *members(value)]:
        assert (each.__doc__ or "").strip(), f"{where} has no docstring"
        if where == name and isinstance(value, type) and issubclass(value, Exception):
            continue
        hints = typing.get_type_hints(each, localns=lazy)
        if isinstance(each, types.FunctionType):
            code = python_inspect.signature(each)
            untyped = [p for p in code.parameters if p not in hints and p not in ("self", "cls")]
            assert not untyped, f"{where}: {untyped}"
            assert "return" in hints, where


def test_the_face_is_cheap():
    code = (
        "import sys, steelyard; print(sorted({'numpy', 'casadi', 'polars', 'pandas', 'plotly',"
        " 'scipy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
