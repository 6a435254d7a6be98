"""The command line: one file per verb, each a few lines around library calls.

``steelyard --help`` must answer at once: these files import what is heavy within their functions.
"""

from __future__ import annotations

import click

from steelyard.cli.lazy_group import LazyGroup
from steelyard.cli.process import run_process

_VERBS = {
    "calibrate": "steelyard.cli.verbs.calibrate:calibrate",
    "campaign": "steelyard.cli.verbs.campaign:campaign",
    "compare": "steelyard.cli.verbs.compare:compare",
    "convert": "steelyard.cli.verbs.files.convert:convert",
    "demo": "steelyard.cli.verbs.demo:demo",
    "design": "steelyard.cli.verbs.design:design",
    "export": "steelyard.cli.verbs.files.export:export",
    "frequencies": "steelyard.cli.verbs.frequencies:frequencies",
    "identify": "steelyard.cli.verbs.identify:identify",
    "import": "steelyard.cli.verbs.files.imports:import_",
    "init": "steelyard.cli.verbs.files.init:init",
    "inspect": "steelyard.cli.verbs.inspect:inspect",
    "new": "steelyard.cli.verbs.files.new:new",
    "report": "steelyard.cli.verbs.report:report",
    "robots": "steelyard.cli.verbs.files.robots:robots",
    "schema": "steelyard.cli.verbs.files.schema:schema",
    "simulate": "steelyard.cli.verbs.simulate:simulate",
    "study": "steelyard.cli.verbs.study:study",
    "verify": "steelyard.cli.verbs.verify:verify",
    "watch": "steelyard.cli.verbs.watch:watch",
}

_GROUPS = {
    "Begin": ("demo", "new", "robots", "import", "init"),
    "Plan and look": ("design", "simulate", "inspect", "convert"),
    "Find": ("identify", "calibrate", "watch", "campaign", "study", "frequencies"),
    "Use": ("report", "compare", "export", "verify"),
}
"""Verbs in the order of work; what stands nowhere comes last."""


@click.group(
    cls=LazyGroup,
    verbs=_VERBS,
    groups=_GROUPS,
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(package_name="steelyard")
def app() -> None:
    """Find the mass, centre of gravity and inertia of what a cable robot carries, and how well each
    is known.

    Begin with `steelyard demo`, or with `steelyard new NAME` or `steelyard init LOG...` on a robot
    and recordings of your own.
    Exit status: 0 done, 2 the input or the command line is wrong, 3 the estimate was made but not
    accepted.
    """


def main() -> None:
    """Run the command line and end with the exit status of the contract."""
    run_process(app)
