"""A mass that walks at random, in the experiment file."""

import pytest
import yaml
from recordings import write_small

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.experiment.write import write_experiment


@pytest.fixture
def described(tmp_path):
    """Writes the small experiment with other keys, and returns its path."""
    path = write_small(tmp_path / "small")

    def write(**keys):
        values = {**yaml.safe_load(path.read_text()), **keys}
        path.write_text(yaml.safe_dump(values, sort_keys=False))
        return path

    return write


@pytest.mark.parametrize(
    ("mass", "known", "walk"),
    [
        ({"walk": 0.05}, {}, 0.05),
        ({"value": 161.1, "sigma": 0.2, "walk": 0.05}, {"mass": (161.1, 0.2)}, 0.05),
        ({"value": 161.1, "walk": 0.05}, {"mass": (161.1, 0.0)}, 0.05),
        ({"value": 161.1, "walk": 0}, {"mass": (161.1, 0.0)}, 0.0),
        (161.1, {"mass": (161.1, 0.0)}, 0.0),
    ],
)
def test_it_is_read_and_written(tmp_path, described, mass, known, walk):
    found = read_experiment(described(known={"mass": mass}))
    assert found.known == known
    assert found.mass_walk == walk
    (tmp_path / "again").mkdir()
    write_experiment(found, tmp_path / "again")
    again = read_experiment(tmp_path / "again" / "experiment.yaml")
    assert again.known == known
    assert again.mass_walk == walk


@pytest.mark.parametrize(
    ("mass", "said"),
    [
        ({"sigma": 0.1}, "'known.mass'.*expected the key 'value' .* found sigma"),
        ({"sigma": 0.1, "walk": 0.1}, "expected the key 'value' .* found sigma, walk"),
        ({"walk": -0.1}, "'known.mass.walk'.*at least 0"),
        ({"walk": "fast"}, "'known.mass.walk'"),
        ({}, "found nothing"),
    ],
)
def test_what_it_cannot_be_is_refused(described, mass, said):
    with pytest.raises(InputError, match=said):
        read_experiment(described(known={"mass": mass}))


@pytest.mark.parametrize("where", ["known", "load"])
def test_of_several_loads_none_walks(described, where):
    own = {"mass": {"walk": 0.1}}
    keys = {"known": own} if where == "known" else {}
    loads = {"one": {"known": own} if where == "load" else {}, "two": {}}
    with pytest.raises(InputError, match=r"mass\.walk'.*expected one body in all runs"):
        read_experiment(described(loads=loads, **keys))
