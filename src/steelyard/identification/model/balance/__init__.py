"""Forces against motion: readings of the forces, the body that moves, and what is left over."""

from __future__ import annotations

from steelyard.identification.model.balance.balance import Balance as Balance
from steelyard.identification.model.balance.balance import balance_at as balance_at
from steelyard.identification.model.balance.balance import balance_of as balance_of
from steelyard.identification.model.balance.balance import (
    disturbance_of_forces as disturbance_of_forces,
)
from steelyard.identification.model.balance.balance import (
    unmodelled_processes as unmodelled_processes,
)
from steelyard.identification.model.balance.behind_filter import forgotten as forgotten
from steelyard.identification.model.balance.force_readings import UNMODELLED as UNMODELLED
from steelyard.identification.model.balance.force_readings import (
    UNMODELLED_PARTS as UNMODELLED_PARTS,
)
from steelyard.identification.model.balance.force_readings import Forces as Forces
from steelyard.identification.model.balance.force_readings import undisturbed as undisturbed
from steelyard.identification.model.balance.measured_force import MeasuredForce as MeasuredForce
from steelyard.identification.model.balance.moving_body import MovingAt as MovingAt
from steelyard.identification.model.balance.moving_body import balance_times as balance_times
from steelyard.identification.model.balance.moving_body import moving_at as moving_at
from steelyard.identification.model.balance.moving_body import moving_body as moving_body
from steelyard.identification.model.balance.moving_body import regressor_at as regressor_at
from steelyard.identification.model.balance.moving_body import time_constant as time_constant
from steelyard.identification.model.balance.rollers import part_of as part_of
from steelyard.identification.model.balance.rollers import parts_of as parts_of
