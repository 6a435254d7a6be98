"""The paper's own numbers, read in: the inertia that Table III estimates belongs to no body."""

import json
from pathlib import Path

import steelyard

table = json.loads((Path(__file__).parent / "estimate.json").read_text(encoding="utf-8"))
bodies = {
    "nominal": steelyard.Inertia.from_dict(table["nominal"]),
    "estimated": steelyard.Inertia.from_dict(table["estimates"][table["result"]]),
}

for name, body in bodies.items():
    i1, i2, i3 = body.principal_moments
    print(f"{name:9}: {body.mass:.3f} kg, principal moments {i1:.2f}, {i2:.2f}, {i3:.2f} kg m^2")
    if body.is_physical:
        print(
            f"           a body can have them: {i1:.2f} + {i2:.2f} is {body.triangle_margin:.2f} kg"
            f" m^2 more than {i3:.2f}"
        )
    else:
        print(
            f"           no body can have them: {i1:.2f} + {i2:.2f} is {-body.triangle_margin:.2f}"
            f" kg m^2 less than {i3:.2f}"
        )

nearest = steelyard.nearest_body(bodies["estimated"], bodies["nominal"])
print(f"nearest  : {nearest}")
body = nearest.solution.body
i1, i2, i3 = body.principal_moments
print(
    f"           that body: {body.mass:.3f} kg, principal moments {i1:.2f}, {i2:.2f}, {i3:.2f}"
    " kg m^2"
)
