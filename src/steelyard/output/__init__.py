"""Results reach their place whole or not at all, and last: written beside it, forced to the disk,
then put there at once.
"""

from __future__ import annotations

from steelyard.output.contents import to_json as to_json
from steelyard.output.contents import write_json as write_json
from steelyard.output.contents import write_table as write_table
from steelyard.output.disk import growing_file as growing_file
from steelyard.output.disk import write_file as write_file
from steelyard.output.hidden import settle as settle
from steelyard.output.results import results_file as results_file
from steelyard.output.results import results_folder as results_folder
from steelyard.output.targets import check_file_target as check_file_target
from steelyard.output.targets import check_target as check_target
