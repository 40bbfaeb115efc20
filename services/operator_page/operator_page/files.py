"""Campaign files and measured files of the page's folder: checked, saved whole or not at all."""

from __future__ import annotations

import hashlib
import re
import secrets
import tempfile
from collections.abc import AsyncIterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import ValidationError

from duralab import Campaign, Catalogue, InputError, Rig
from duralab.campaign import (
    campaign_text,
    check_against_rig,
    parse_campaign,
    shipped_campaigns,
    shipped_text,
    template_for,
)
from duralab.output_files import replace_when_complete
from duralab_schedules import Schedule
from duralab_settings import YamlError, dump_yaml, explain_validation, parse_yaml

UPLOADS: Final = "uploads"
DRIVES: Final = "drives"
RECORDING_ID: Final = re.compile(r"[a-z0-9][a-z0-9_-]{0,79}")
SUFFIXES: Final = (".rsp", ".drv", ".tim", ".mf4", ".uff", ".unv", ".tdms", ".mat", ".parquet", ".csv")
MOST_UPLOADS: Final = 200


class PageFiles:
    """Folder of the page; `largest_bytes`: Largest size of a file from a browser."""

    def __init__(self, folder: Path, *, largest_bytes: int) -> None:
        self.folder, self._largest_bytes = folder, largest_bytes

    def listed(self) -> dict[str, Any]:
        """Return the names of all campaigns and schedules.

        `rigs`: Rigs of each readable campaign by `kind:name`, its own first. `schedule_rigs`: Rig of each readable
        schedule.
        """
        files, shipped = sorted(self.folder.glob("*.yaml")), shipped_campaigns()
        schedules = [path.stem for path in files if _is_schedule(path)]
        campaigns = [path.stem for path in files if path.stem not in schedules]
        rigs: dict[str, list[str]] = {}
        for kind, names in (("file", campaigns), ("shipped", shipped)):
            for name in names:
                with suppress(InputError, OSError, UnicodeDecodeError):
                    rigs[f"{kind}:{name}"] = list(self._campaign(kind, name).rigs)
        schedule_rigs: dict[str, str] = {}
        for name in schedules:
            with suppress(InputError, OSError, UnicodeDecodeError):
                schedule_rigs[name] = self.read_schedule(self.path(name).read_text(encoding="utf-8")).rig
        return {
            "shipped": shipped,
            "files": campaigns,
            "schedules": schedules,
            "rigs": rigs,
            "schedule_rigs": schedule_rigs,
        }

    def path(self, name: str) -> Path:
        """Return the path of the campaign of a name; the name is checked, and holds no separator."""
        return self.folder / f"{name}.yaml"

    def document(self, kind: str, name: str) -> dict[str, Any]:
        """Return a campaign file as a document to edit."""
        return self._as_document(self._campaign(kind, name))

    def _campaign(self, kind: str, name: str) -> Campaign:
        if kind == "shipped":
            text = shipped_text(name)
        else:
            path = self.path(name)
            if not path.is_file():
                raise InputError(f"There is no campaign file {name!r} on this page.", field="name")
            text = path.read_text(encoding="utf-8")
        return parse_campaign(text, name=name, folder=self.folder)

    def template(self, rig: Rig) -> dict[str, Any]:
        """Return a new campaign for a rig, with an experiment for the rig's drives."""
        text = campaign_text(template_for(rig.name), path=self.path("new"), rig=rig)
        return self._as_document(parse_campaign(text, name="new", folder=self.folder))

    @staticmethod
    def _as_document(plan: Campaign) -> dict[str, Any]:
        return yaml.safe_load(yaml.safe_dump(plan.model_dump(mode="json", exclude_unset=True)))

    def checked(self, document: Mapping[str, Any], rig: Rig | None) -> tuple[Campaign, str]:
        """Check a document as the command line checks a file; return the campaign, and the text of that file."""
        text = dump_yaml(dict(document))
        plan = parse_campaign(text, name=str(document.get("name", "campaign")), folder=self.folder)
        measured = plan.target.file or (plan.target.opencrg.path if plan.target.opencrg is not None else None)
        if measured is not None and not self._is_inside(measured):
            raise InputError(f"target is {str(measured)!r}; give a file that was put on this page.", field="target")
        if rig is not None:
            check_against_rig(plan, rig)
        return plan, text

    def read_schedule(self, text: str) -> Schedule:
        """Return the schedule of a text whose paths start in the page's folder."""
        try:
            return Schedule.model_validate(parse_yaml(text)).read_from(self.folder)
        except ValidationError as error:
            found = explain_validation(error, Schedule)
            raise InputError(found.sentence, field=found.field) from error
        except YamlError as error:
            raise InputError(f"The schedule is not YAML: {error}.") from error

    def checked_schedule(self, document: Mapping[str, Any]) -> tuple[Schedule, str]:
        """Check a schedule as the command line checks its file; return it, and the text of that file."""
        text = dump_yaml(dict(document))
        schedule = self.read_schedule(text)
        plan = schedule.plan.mix or {} if schedule.plan is not None else {}
        named = [event.drive for event in schedule.events.values()]
        named += [each.target for each in (*schedule.events.values(), *plan.values()) if each.target is not None]
        for path in named:
            if not self._is_inside(Path(path)):
                raise InputError(f"The drive or target is {path!r}; give a file that was put on this page.")
        return schedule, text

    def _is_inside(self, path: Path) -> bool:
        return (self.folder / path).resolve().is_relative_to(self.folder.resolve())

    def require_free(self, name: str, *, replace: bool) -> None:
        """Refuse the name of an existing file."""
        if self.path(name).exists() and not replace:
            raise InputError(f"There is a file {name!r} already; give another name, or replace it.", field="name")

    def save(self, plan: Campaign | Schedule, text: str, *, replace: bool) -> None:
        """Save a campaign or a schedule under its name."""
        self.require_free(plan.name, replace=replace)
        with replace_when_complete(self.path(plan.name)) as part:
            part.write_text(text, encoding="utf-8")

    async def upload(self, name: str, pieces: AsyncIterator[bytes]) -> str:
        """Store an uploaded file; return its path in the folder, which no other file has."""
        suffix = Path(name).suffix.lower()
        if suffix not in SUFFIXES:
            raise InputError(f"The file {name!r} is of no known kind; give one of {', '.join(SUFFIXES)}.", field="file")
        folder = self.folder / UPLOADS
        folder.mkdir(exist_ok=True)
        if sum(1 for _ in folder.iterdir()) >= MOST_UPLOADS:
            raise InputError(
                f"{MOST_UPLOADS} files are kept already in {folder.name}; remove some first.", field="file"
            )
        part, digest, size = folder / f".{secrets.token_hex(8)}.part", hashlib.sha256(), 0
        try:
            with part.open("xb") as stream:
                async for piece in pieces:
                    size += len(piece)
                    if size > self._largest_bytes:
                        raise InputError(
                            f"The file is larger than {self._largest_bytes // 2**20} MiB; shorten it first.",
                            field="file",
                        )
                    digest.update(piece)
                    stream.write(piece)
            stem = re.sub(r"[^A-Za-z0-9_-]+", "_", Path(name).stem)[:60] or "file"
            kept = f"{stem}-{digest.hexdigest()[:8]}{suffix}"
            part.replace(folder / kept)
        finally:
            part.unlink(missing_ok=True)
        return f"{UPLOADS}/{kept}"


def _is_schedule(path: Path) -> bool:
    """Return whether a file is a schedule: its events have drives, those of a project have targets."""
    try:
        events = (parse_yaml(path.read_text(encoding="utf-8")) or {}).get("events")
        return isinstance(events, dict) and all("drive" in (event or {}) for event in events.values())
    except (OSError, ValueError, AttributeError, TypeError):
        return False


def fetched_drives(schedule: Schedule, catalogue: Catalogue, folder: Path) -> Schedule:
    """Return a schedule with files as drives: recordings that it names by their ids are fetched."""
    events = dict(schedule.events)
    for name, event in events.items():
        if RECORDING_ID.fullmatch(event.drive) and not (schedule.folder / event.drive).exists():
            kept = folder / DRIVES / event.drive
            if not kept.is_dir():
                kept.parent.mkdir(exist_ok=True)
                # Whole or not at all, also if two people request it at once.
                with tempfile.TemporaryDirectory(dir=kept.parent, prefix=".") as passing:
                    catalogue.fetch(event.drive, Path(passing) / kept.name)
                    with suppress(OSError):
                        (Path(passing) / kept.name).rename(kept)
            events[name] = event.model_copy(update={"drive": str(kept)})
    return schedule.model_copy(update={"events": events}).read_from(schedule.folder)
