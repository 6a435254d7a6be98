"""Whatever of a campaign is killed, nothing is lost and nothing is there twice."""

import pytest
from killed_campaigns import TARGETS, campaign_of, killed, recordings_in

COUNT = 8
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    top = tmp_path_factory.mktemp("killed")
    data = recordings_in(top / "data", COUNT)
    whole = campaign_of(data, top / "whole", "--jobs", "1")
    whole.communicate()
    assert whole.returncode == 0
    return data


@pytest.mark.long
@pytest.mark.parametrize(
    ("engine", "target"), [(e, target) for e, targets in TARGETS.items() for target in targets]
)
def test_the_table_after_a_kill_is_the_undisturbed_one(engine, target, data, tmp_path):
    if engine == "dask":
        pytest.importorskip("distributed")
    found = killed(engine, target, data, tmp_path / "out", COUNT, seed=1)
    assert (found.lost, found.twice, found.same) == (0, 0, True)
    if target == "worker":
        assert found.status == 0
    assert found.again >= min(found.rows, COUNT)
    assert "Traceback" not in found.said
