"""Opening a workbench: with files, a built-in record, or earlier steps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ..readers import Options
from .acts import ModelSettings, guessed
from .bench import Bench
from .source import built_in, effects_in, opened
from .takeaway import with_past
from .tiles import Store


@dataclass(frozen=True, kw_only=True)
class Opening:
    """Arguments with which a workbench is opened."""

    paths: tuple[str, ...] = ()
    """Files of the log; none for a built-in record."""
    sample: str = ""
    """Which built-in record; the first by default."""
    names: tuple[str, ...] = ()
    """What they are called, if that is not their paths' ends."""
    how: Options = field(default_factory=Options)
    named: dict[str, str] = field(default_factory=dict)
    """Columns whose role the user has said."""
    settings: ModelSettings = field(default_factory=ModelSettings)
    own_file: str = ""
    past: Any = None
    """What was done already, see `past_node`."""

    def bench(self, store: Store) -> Bench:
        """The bench, its log read; RecordError where that cannot be."""
        own = effects_in(self.own_file) if self.own_file else ()
        files = self.paths and opened(self.paths, self.how, names=self.names)
        source = files or built_in(self.sample)
        roles = guessed(source.frame, **self.named)
        bench = Bench(source, store, roles=roles, settings=self.settings, own=own, own_file=self.own_file)
        return bench if self.past is None else with_past(bench, self.past)
