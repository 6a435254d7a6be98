"""Several loads that swing on locked cables without force sensors, in one fit."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from mujoco_swings import BODY, swings

from steelyard.errors import InputError
from steelyard.estimates.per_mass import PerMass
from steelyard.experiment.model import Load
from steelyard.experiment.read import read_experiment
from steelyard.experiment.unread import with_unread_cables
from steelyard.experiment.write import write_experiment
from steelyard.identification.identify import identify
from steelyard.identification.model.calibration_parameters import gather
from steelyard.inertia import Inertia

pytestmark = pytest.mark.integration

TOOL = Inertia(4.0, np.array([-0.1, 0.12, 0.1]), 0.02 * np.eye(3))
WITH_TOOL = Inertia.from_parameters(BODY.parameters + TOOL.parameters)
WEIGHED = 0.01  # [kg]


def recorded(seed, runs=3, duration=8.0):
    """The same robot, whose geometry is off by the same, without and with the tool."""
    rng = np.random.default_rng([seed, 7])
    found, loads = [], []
    for name, body in (("empty", BODY), ("tool", WITH_TOOL)):
        own = swings(3, runs, seed, duration=duration, body=body)
        known = {"mass": (body.mass + WEIGHED * rng.normal(), WEIGHED)}
        loads.append(Load(name, known=known))
        found += [
            replace(
                run, name=f"{run.name} {name}", load=name, streams={"pose": run.streams["pose"]}
            )
            for run in own.experiment.runs
        ]
    plain = replace(
        own.experiment,
        instruments={"pose": own.experiment.instruments["pose"]},
        runs=tuple(replace(run, sync={}) for run in found),
        loads=tuple(loads),
        known=loads[0].known,
        mass_assumed=False,
    )
    return with_unread_cables(plain)


def test_cables_carry_what_each_run_does():
    experiment = recorded(1, runs=1, duration=2.0)
    (name,) = set(experiment.instruments) - {"pose"}
    weights = [run.streams[name].values["tension"].sum(axis=1)[0] for run in experiment.runs]
    np.testing.assert_allclose(weights, [9 * 9.81, 13 * 9.81], rtol=0.005)


def test_what_damps_is_of_each_load():
    experiment = recorded(1, runs=2, duration=2.0)
    entries = gather(experiment).entries
    damped = [each.run for each in entries if each.key == "damping.moving"]
    assert damped == ["swing 0 tool", "swing 1 tool", None]


def test_a_load_of_unknown_mass_is_refused(tmp_path):
    write_experiment(recorded(1, runs=1, duration=2.0), tmp_path)
    path = tmp_path / "experiment.yaml"
    values = yaml.safe_load(path.read_text())
    assert [run["load"] for run in values["runs"]] == ["empty", "tool"]
    assert [load.name for load in read_experiment(path).loads] == ["empty", "tool"]
    del values["loads"]["tool"]["known"]
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    with pytest.raises(InputError, match=r"experiment\.yaml:\d+: 'loads\.tool'") as error:
        read_experiment(path)
    assert "expected the mass of load 'tool', whose runs read no forces" in str(error.value)
    # Of one load a mass is assumed, as without loads, and not written as known.
    values["runs"] = values["runs"][:1]
    del values["loads"]["tool"], values["loads"]["empty"]["known"]
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    found = read_experiment(path)
    assert found.mass_assumed
    assert "mass" in found.loads[0].known
    (tmp_path / "again").mkdir()
    write_experiment(found, tmp_path / "again")
    assert "known" not in (tmp_path / "again" / "experiment.yaml").read_text()


@pytest.mark.slow
@pytest.mark.long
def test_loads_that_swing_in_mujoco_share_the_geometry():
    chi, differences = [], []
    for seed in (31, 32):
        found = identify(recorded(seed))
        assert list(found.estimates) == ["force-free", "maximum-likelihood"]
        loads = found.estimate.loads
        assert found.estimates["force-free"].loads is not None
        for estimate, body in zip(loads.estimates.values(), (BODY, WITH_TOOL), strict=True):
            assert estimate.verdict.accepted, estimate.verdict.reasons
            truth = PerMass.of(body.body_parameters, np.zeros((10, 10))).value
            off = estimate.per_mass.value - truth
            chi.append(off @ np.linalg.solve(estimate.per_mass.covariance, off) / 9)
            assert np.abs(off[3:6] / truth[3:6]).max() < 0.02
        more = loads.differences["tool - empty"]
        off = more.value - TOOL.body_parameters
        differences.append(off @ np.linalg.solve(more.covariance, off) / 10)
        # Attachments that are 2 mm off shift both by the same.
        shared = loads.estimates["tool"].standard_deviation[1:4]
        assert (more.standard_deviation[1:4] * TOOL.mass / WITH_TOOL.mass < 0.6 * shared).all()
    assert 0.2 < np.mean(chi) < 2
    assert 0.2 < np.mean(differences) < 2
