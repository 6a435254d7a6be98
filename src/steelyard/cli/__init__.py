"""The command line: one file per verb, each a few lines around library calls.

``steelyard --help`` must answer at once: these files import what is heavy within their functions.
"""

from __future__ import annotations

import click

from steelyard.cli.lazy_group import LazyGroup
from steelyard.cli.process import run_process

_VERBS = {
    "compare": "steelyard.cli.compare:compare",
    "convert": "steelyard.cli.convert:convert",
    "demo": "steelyard.cli.demo:demo",
    "design": "steelyard.cli.design:design",
    "export": "steelyard.cli.export:export",
    "identify": "steelyard.cli.identify:identify",
    "import": "steelyard.cli.imports:import_",
    "init": "steelyard.cli.init:init",
    "inspect": "steelyard.cli.inspect:inspect",
    "report": "steelyard.cli.report:report",
    "robots": "steelyard.cli.robots:robots",
    "schema": "steelyard.cli.schema:schema",
    "simulate": "steelyard.cli.simulate:simulate",
}


@click.group(
    cls=LazyGroup,
    verbs=_VERBS,
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(package_name="steelyard")
def app() -> None:
    """Find the mass, centre of gravity and inertia of what a cable robot carries, and how well each
    is known.

    Begin with `steelyard demo`, or with `steelyard identify EXPERIMENT` on recordings of your own.
    Exit status: 0 done, 2 the input or the command line is wrong, 3 the estimate was made but not
    accepted.
    """


def main() -> None:
    """Run the command line and end with the exit status of the contract."""
    run_process(app)
