"""Settings of an identification, from a campaign or from a separate file."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, ValidationError

from duralab.campaign.loading import explained, load_campaign, parse_mapping, read_text, shipped_campaigns
from duralab_settings import EstimatorSettings, ExcitationSettings, Section, Seed


class IdentificationSettings(Section):
    """Settings of an identification."""

    seed: Seed = Field(default=0, description="Seed of all random numbers of the experiment.")
    excitation: ExcitationSettings = Field(description="Experiment that identifies the rig.")
    estimator: EstimatorSettings = Field(description="Estimator of the model from the experiment.")


def load_identification(source: str | Path) -> IdentificationSettings:
    """Read and check the settings of an identification.

    `source`: A campaign file or the name of a shipped campaign, of which seed, excitation and estimator are used; or a
    YAML file with these keys only.
    Returns: The checked settings.
    Raises `InputError`: There is no such file, it is not YAML, or a key or value in it is not allowed.
    """
    path = Path(source)
    # A folder may have the name, e.g. one with results.
    if not path.is_file() and str(source) in shipped_campaigns():
        return _of_campaign(source)
    text = read_text(path, what="a file of settings")
    content = parse_mapping(text, name=str(path), what="it", keys=IdentificationSettings.model_fields)
    if "target" in content or "update" in content:
        return _of_campaign(source)
    try:
        return IdentificationSettings.model_validate(content)
    except ValidationError as error:
        raise explained(error, name=f"{path}: ") from error


def _of_campaign(source: str | Path) -> IdentificationSettings:
    campaign = load_campaign(source)
    return IdentificationSettings.model_construct(
        seed=campaign.seed, excitation=campaign.excitation, estimator=campaign.estimator
    )
