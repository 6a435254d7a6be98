"""Dead weights on the force sensors: what nobody knew of their gains, and with it of the mass."""

import sys
import tempfile
from pathlib import Path

import numpy as np
import polars as pl

import steelyard

HERE = Path(__file__).parent
MASSES = [5.0, 20.0, 50.0, 100.0]  # [kg]
NOISE = 1.0  # [N], of a reading at rest

temporary = tempfile.TemporaryDirectory()
folder = Path(sys.argv[1] if len(sys.argv) > 1 else temporary.name) / "recorded"
virtual = steelyard.simulate(
    "cogiro", sensors=str(HERE / "sensors.yaml"), duration=12.0, seed=4, name="dead weights"
)
virtual.write(folder)

# What a person writes down who hangs four weights on each of the eight cells, one after the other.
cells = virtual.truth()["calibration"]["cables"]
gain = cells["common_gain"][0] * np.array(cells["gain"])
rng = np.random.default_rng(7)
rows = [
    (cable + 1, mass, gain[cable] * mass * 9.81 + cells["offset"][cable] + NOISE * noise)
    for cable in range(len(gain))
    for mass, noise in zip(MASSES, rng.standard_normal(len(MASSES)), strict=True)
]
lines = ["cable,mass,f", *(f"{cable},{mass:g},{f:.2f}" for cable, mass, f in rows)]
(folder / "weights.csv").write_text("\n".join(lines) + "\n")

# Two entries in the experiment file.
plain = folder / "experiment.yaml"
text = plain.read_text().replace(
    "instruments:\n", f"instruments:\n  weights: {{kind: weight, of: cables, noise: {NOISE:g}}}\n"
)
weighed = folder / "with-weights.yaml"
weighed.write_text(text.rstrip() + "\n- {name: bench, weights: weights.csv}\n")

found = {
    name: steelyard.identify(steelyard.read_experiment(path), "maximum-likelihood").estimate
    for name, path in (("without weights", plain), ("with weights", weighed))
}
truth = virtual.body.body_parameters
for name, estimate in found.items():
    print(f"\n{name}: {estimate.verdict}")
    for note in estimate.notes:
        print(f"note: {note}")
    table = estimate.to_polars().select("parameter", "unit", "value", "sigma")
    with pl.Config(tbl_hide_dataframe_shape=True, tbl_rows=10, float_precision=4):
        print(
            table.with_columns(
                truth=truth, error_in_sigmas=(pl.col("value") - truth) / pl.col("sigma")
            )
        )
before, after = (estimate.standard_deviation[0] for estimate in found.values())
print(f"\n1-sigma of the mass: {before:.3f} kg without weights, {after:.3f} kg with them")
temporary.cleanup()
