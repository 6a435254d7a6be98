"""Tables of dead weights: read, kept apart from the runs, and written again."""

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment, read_plan
from steelyard.experiment.write import write_experiment

FILE = """
format: steelyard/1
robot: cogiro
instruments:
  cables: {kind: tension}
  tracker: {kind: pose}
  weights: {kind: weight, of: cables, noise: 2.0, calibration: {scale: 1.0e-4}}
runs:
  - {name: poses, static: true, cables: poses.csv, tracker: poses.csv}
  - {name: bench, weights: weights.csv}
"""
ROWS = [(1, 10, 98.5), (1, 50, 491.0), (3, 10, 97.9), (3, 50, 490.1), (8, 0, 0.4)]


def written(folder, text=FILE, rows=ROWS, head="cable,mass,f"):
    rng = np.random.default_rng(0)
    names = [*(f"f{i + 1}" for i in range(8)), "x", "y", "z", "roll", "pitch", "yaw"]
    poses = [",".join(names)]
    for _ in range(4):
        numbers = [*rng.uniform(200, 900, 8), *rng.uniform(0.5, 1.5, 3), 0, 0, 0]
        poses.append(",".join(f"{v:.3f}" for v in numbers))
    (folder / "poses.csv").write_text("\n".join(poses) + "\n")
    lines = [head, *(",".join(map(str, row)) for row in rows)]
    (folder / "weights.csv").write_text("\n".join(lines) + "\n")
    (folder / "experiment.yaml").write_text(text)
    return folder / "experiment.yaml"


def test_a_table_is_no_run(tmp_path):
    found = read_experiment(written(tmp_path))
    assert [run.name for run in found.runs] == ["poses"]
    assert list(found.instruments) == ["cables", "tracker"]
    (table,) = found.weights
    assert (table.run, table.instrument, table.of) == ("bench", "weights", "cables")
    np.testing.assert_array_equal(table.cable, [1, 1, 3, 3, 8])
    np.testing.assert_array_equal(table.mass, [10, 50, 10, 50, 0])
    np.testing.assert_array_equal(table.reading, [98.5, 491.0, 97.9, 490.1, 0.4])


@pytest.mark.parametrize(
    "entry",
    [
        "  - {name: bench, static: true, weights: weights.csv}",
        "  - {name: bench, weights: {file: weights.csv, units: {mass: kg, f: N}}}",
    ],
)
def test_a_run_of_weights_is_told_in_either_way(tmp_path, entry):
    text = FILE.replace("  - {name: bench, weights: weights.csv}", entry)
    (table,) = read_experiment(written(tmp_path, text)).weights
    assert len(table) == 5


def test_it_may_stand_beside_the_streams_of_a_run(tmp_path):
    text = FILE.replace("  - {name: bench, weights: weights.csv}\n", "").replace(
        "tracker: poses.csv}", "tracker: poses.csv, weights: weights.csv}"
    )
    found = read_experiment(written(tmp_path, text))
    assert found.weights[0].run == "poses"
    assert list(found.runs[0].streams) == ["cables", "tracker"]


def test_units_of_the_file_are_known(tmp_path):
    rows = [(cable, 1000 * mass, force / 1000) for cable, mass, force in ROWS]
    text = FILE.replace(
        "weights: weights.csv", "weights: {file: weights.csv, units: {mass: g, f: kN}}"
    )
    (table,) = read_experiment(written(tmp_path, text, rows)).weights
    np.testing.assert_allclose(table.mass, [10, 50, 10, 50, 0])
    np.testing.assert_allclose(table.reading, [98.5, 491.0, 97.9, 490.1, 0.4])
    in_head = written(tmp_path, FILE, rows, head="cable [-],mass [g],f [kN]")
    np.testing.assert_allclose(read_experiment(in_head).weights[0].mass, table.mass)


@pytest.mark.parametrize("tables", ["csv", "parquet"])
def test_it_comes_back_as_it_was_written(tmp_path, tables):
    found = read_experiment(written(tmp_path))
    (tmp_path / "copy").mkdir()
    write_experiment(found, tmp_path / "copy", tables=tables)
    again = read_experiment(tmp_path / "copy" / "experiment.yaml")
    (table,), (copy,) = found.weights, again.weights
    assert copy.description == table.description
    for key in ("cable", "mass", "reading"):
        np.testing.assert_array_equal(getattr(copy, key), getattr(table, key))
    assert copy.run == "bench"


def test_a_plan_has_no_weights_to_look_for(tmp_path):
    text = FILE.replace("kind: tension", "kind: tension, rate: 100").replace(
        "kind: pose", "kind: pose, rate: 100"
    )
    plan = read_plan(written(tmp_path, text))
    assert list(plan.instruments) == ["cables", "tracker"]


def cell(row, column, value):
    rows = [list(each) for each in ROWS]
    rows[row][column] = value
    return rows


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (cell(1, 0, 9), "run 'bench': row 2 of 'weights': expected the number of a cable, 1 to 8"),
        (cell(1, 0, 0), "found 0; correct it"),
        (cell(1, 0, 1.5), "found 1.5; correct it"),
        (cell(1, 0, ""), "found nothing; correct it"),
        (cell(3, 1, -50), "row 4 of 'weights': expected a mass of zero or more"),
        (cell(3, 1, ""), "in column 'mass', found nothing"),
        ([(c, 1000 * m, f) for c, m, f in ROWS], "masses seem to be in grams"),
        ([(c, m, f / 1000) for c, m, f in ROWS], "or readings in kilonewtons"),
        ([(c, m / 1000, f) for c, m, f in ROWS], "masses seem to be in tonnes"),
        ([(c, m, f / 9.81) for c, m, f in ROWS], "readings seem to be in kilograms"),
    ],
)
def test_rows_that_cannot_be_are_named(tmp_path, rows, said):
    with pytest.raises(InputError) as error:
        read_experiment(written(tmp_path, rows=rows))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_cells_that_read_in_units_of_their_own_are_no_mistake(tmp_path):
    """A gain that is stated as a thousandth: an amplifier that shows kilonewtons."""
    text = FILE.replace(
        "{kind: tension}",
        "{kind: tension, calibration: {gain: {value: 1.0e-3, sigma: 1.0e-5}}}",
    )
    rows = [(c, m, f / 1000) for c, m, f in ROWS]
    assert len(read_experiment(written(tmp_path, text, rows)).weights) == 1


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("of: cables", "of: cabels", "of kind 'tension', found 'cabels'; known here: cables"),
        ("of: cables", "of: tracker", "of kind 'tension', found 'tracker'"),
        ("of: cables, ", "", "expected this key, found it missing; add 'of'"),
        ("kind: tension", "kind: tension, without: [3]", "found 3, which is under its 'without'"),
        ("scale: 1.0e-4", "gain: 1.0e-4", "gain"),
        (
            "  - {name: poses, static: true, cables: poses.csv, tracker: poses.csv}\n",
            "",
            "expected a run of the platform beside the dead weights",
        ),
    ],
)
def test_what_does_not_fit_is_said(tmp_path, old, new, said):
    assert old in FILE
    with pytest.raises(InputError) as error:
        read_experiment(written(tmp_path, FILE.replace(old, new)))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_load_needs_a_run_of_its_own(tmp_path):
    loads = "loads: {empty: {}, full: {}}\ninstruments:"
    text = FILE.replace("instruments:", loads).replace("name: bench,", "name: bench, load: full,")
    with pytest.raises(InputError, match="expected a run that carries 'full'"):
        read_experiment(written(tmp_path, text))
    # Something that moves in the platform does not matter to weights.
    loose = FILE.replace("instruments:", "loads: {empty: {rigid: false}}\ninstruments:")
    assert len(read_experiment(written(tmp_path, loose)).weights) == 1
