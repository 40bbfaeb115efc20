"""The page of metrics, from what the services of a lab answer: `python -m tests.metrics_page.page` writes it again."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from duralab_bus import BusConfig, open_bus
from duralab_proto.v1 import health_pb2

from ..error_sentences.shared_lab import shared_lab

PAGE: Final = Path(__file__).resolve().parents[2] / "docs/reference/metrics.md"
RIG: Final = "front_axle_wearing"
"""A rig that has all metrics of rigs, those of wear too."""

_UNITS: Final = {"seconds": "s", "bytes": "B", "ratio": "1", "hertz": "Hz"}
_HEAD: Final = """# Metrics

What every service counts and measures about itself: the same names at its page for Prometheus and in its answer to a
[health](messages.md#Health) query, which `Lab.health` of the SDK asks. Counters begin at 0 with the process and end
in `_total`; the unit is the end of the name. [Operate a secured lab](../guides/secured_lab.md#figures) says how
they are published, which alerts and dashboards come with it.

`python -m tests.metrics_page.page` writes this page from a running lab, and a test holds it to one.
"""


@dataclass
class Family:
    """One metric, with the services that have it."""

    kind: str
    labels: tuple[str, ...]
    what: str
    services: list[str] = field(default_factory=list)


def page(healths: Sequence[health_pb2.Health]) -> str:
    """Return the page for the answers of all services."""
    families: dict[str, Family] = {}
    for health in healths:
        for figure in health.figures:
            family = families.setdefault(figure.name, Family(_kind(figure.kind), tuple(figure.labels), figure.what))
            if health.service not in family.services:
                family.services.append(health.service)
    services = list(dict.fromkeys(health.service for health in healths))
    parts = [_HEAD, *_section("Every service", families, services)]
    groups = sorted({tuple(family.services) for family in families.values() if family.services != services})
    for group in groups:
        parts += _section(", ".join(group), families, list(group))
    return "\n".join(parts)


def _section(title: str, families: dict[str, Family], services: list[str]) -> Iterator[str]:
    yield f"## {title}\n\n| name | type | unit | labels | meaning |\n| --- | --- | --- | --- | --- |"
    for name, family in sorted(families.items()):
        if family.services == services:
            labels = ", ".join(f"`{label}`" for label in family.labels)
            yield f"| `{name}` | {family.kind} | {unit_of(name)} | {labels} | {family.what} |"
    yield ""


def _kind(kind: int) -> str:
    return health_pb2.FigureKind.Name(kind).removeprefix("FIGURE_KIND_").lower()


def unit_of(name: str) -> str:
    """Return the unit that the end of a name says; empty for plain numbers."""
    return _UNITS.get(name.removesuffix("_total").rpartition("_")[2], "")


@contextmanager
def healths_of_lab(folder: Path) -> Iterator[list[health_pb2.Health]]:
    """Start a lab with the operator page, and yield what its services answer, in the order of their names."""
    with (
        shared_lab(folder, "--page", rigs=(RIG,)) as endpoint,
        open_bus(BusConfig(connect=(endpoint,)), service="metrics_page") as bus,
    ):
        yield [
            bus.query(bus.keys.health(service, instance), health_pb2.HealthRequest(), health_pb2.Health)
            for service, instance in sorted(bus.discover())
        ]


def main() -> int:
    """Write the page."""
    with tempfile.TemporaryDirectory(prefix="duralab-metrics-") as folder, healths_of_lab(Path(folder)) as healths:
        PAGE.write_text(page(healths), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
