"""The systematic errors of an experiment as one vector: every instrument's terms, the clocks, and
the robot file itself.

Estimators, bounds and tests speak of the same errors by the same places; their priors are those of
the contract.
"""

from __future__ import annotations

from steelyard.identification.model.calibration_parameters.further_loads import (
    load_place as load_place,
)
from steelyard.identification.model.calibration_parameters.further_loads import (
    with_last_load as with_last_load,
)
from steelyard.identification.model.calibration_parameters.gather import gather as gather
from steelyard.identification.model.calibration_parameters.keys import AIR as AIR
from steelyard.identification.model.calibration_parameters.keys import ATTACHED as ATTACHED
from steelyard.identification.model.calibration_parameters.keys import BENDING as BENDING
from steelyard.identification.model.calibration_parameters.keys import (
    BENDING_KEYS as BENDING_KEYS,
)
from steelyard.identification.model.calibration_parameters.keys import DAMPING as DAMPING
from steelyard.identification.model.calibration_parameters.keys import DRAG as DRAG
from steelyard.identification.model.calibration_parameters.keys import ROBOT as ROBOT
from steelyard.identification.model.calibration_parameters.keys import SWIVEL as SWIVEL
from steelyard.identification.model.calibration_parameters.keys import element_of as element_of
from steelyard.identification.model.calibration_parameters.of_instruments import (
    clock_of as clock_of,
)
from steelyard.identification.model.calibration_parameters.of_instruments import (
    shares_clock as shares_clock,
)
from steelyard.identification.model.calibration_parameters.surroundings import (
    hose_keys as hose_keys,
)
from steelyard.identification.model.calibration_parameters.tree import as_tree as as_tree
from steelyard.identification.model.calibration_parameters.tree import (
    instruments_of as instruments_of,
)
from steelyard.identification.model.calibration_parameters.values import (
    CalibrationValues as CalibrationValues,
)
from steelyard.identification.model.calibration_parameters.vector import (
    CalibrationParameter as CalibrationParameter,
)
from steelyard.identification.model.calibration_parameters.vector import (
    CalibrationParameters as CalibrationParameters,
)
from steelyard.identification.model.calibration_parameters.vector import Key as Key
from steelyard.identification.model.calibration_parameters.vector import columns_of as columns_of
