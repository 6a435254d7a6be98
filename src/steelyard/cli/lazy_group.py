"""A group of commands of which each is imported when it is asked for, as Click's documentation has
it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Any

import click


class LazyGroup(click.Group):
    """Commands by the place of their function; all are imported for ``--help``, which says a
    sentence of each.
    """

    def __init__(
        self,
        *args: Any,
        verbs: Mapping[str, str],
        groups: Mapping[str, Sequence[str]] | None = None,
        **settings: Any,
    ) -> None:
        """Beside what :class:`click.Group` takes: verb -> ``module:function``, and heading -> verbs
        of it for ``--help``.
        """
        super().__init__(*args, **settings)
        self._verbs, self._groups = verbs, groups or {}

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """A list of verbs under each heading, and of those that have none."""
        grouped = {verb for verbs in self._groups.values() for verb in verbs}
        rest = tuple(verb for verb in self.list_commands(ctx) if verb not in grouped)
        width = max(map(len, self._verbs))
        for heading, verbs in {**self._groups, "More": rest}.items():
            rows = []
            for verb in verbs:
                command = self.get_command(ctx, verb)
                if command is not None:
                    limit = formatter.width - 6 - width
                    rows.append((verb.ljust(width), command.get_short_help_str(limit)))
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """A verb; the nearest ones are named where there is none of its name."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            near = get_close_matches(args[0], self._verbs, n=2)
            if not near:
                raise
            likely = " or ".join(map(repr, near))
            said = f"{error.message.rstrip('.')}; did you mean {likely}?"
            raise click.UsageError(said, ctx) from None

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All verbs, in the order of the alphabet."""
        return sorted(self._verbs)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A verb by its name; None where there is none of it."""
        if cmd_name not in self._verbs:
            return None
        module, _, function = self._verbs[cmd_name].partition(":")
        command = getattr(import_module(module), function)
        assert isinstance(command, click.Command)
        return command
