"""What a model says of lines at which nothing was estimated: nothing; and of which unit its elements are."""

import numpy as np
import pytest

from duralab.cli.commands.export import write_frf
from duralab.cli.commands.play import _model_document
from duralab.data import Model
from duralab.formats import read_frequency_response
from duralab.report.model_figures import contributions
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import identifier_pb2

FIRST, LAST = 2, 81
"""Lines that were excited, 0.98 to 39.6 Hz."""


@pytest.fixture
def message(campaign):
    """A model as the identifier answers it: 0 at the lines outside the band of the excitation."""
    message = identifier_pb2.Model()
    message.CopyFrom(campaign.model)
    for name in ("frf", "coherence", "condition_number", "frf_variance"):
        field = getattr(message, name)
        values = from_array(field, field=name).copy()
        values[:FIRST] = 0.0
        values[LAST + 1 :] = 0.0
        field.CopyFrom(to_array(values))
    return message


def test_where_nothing_was_estimated_nothing_is_told(message):
    model = Model.from_message(message).to_xarray()
    known = np.zeros(model.sizes["frequency"], dtype=bool)
    known[FIRST : LAST + 1] = True
    for name in ("frf", "frf_deviation", "coherence", "condition_number"):
        finite = np.isfinite(model[name].values)
        np.testing.assert_array_equal(
            finite, np.broadcast_to(known.reshape(-1, *(1,) * (finite.ndim - 1)), finite.shape)
        )
    np.testing.assert_array_equal(model.frf.values[known], from_array(message.frf, field="frf")[known])


def test_a_file_and_a_document_hold_the_lines_that_were_estimated(message, tmp_path):
    model = Model.from_message(message)
    path = tmp_path / "frf.uff"
    write_frf(model, path, replace=False)
    written = read_frequency_response(path)
    np.testing.assert_allclose(written.frequency, model.frequency[FIRST : LAST + 1], rtol=1e-6)
    document = _model_document("front_axle", model, path)
    limits = (document["lines"], document["lowest_frequency"], document["highest_frequency"])
    assert limits == (LAST + 1 - FIRST, model.frequency[FIRST], model.frequency[LAST])


def test_a_line_of_the_band_without_an_estimate_adds_nothing_to_what_a_drive_caused(message):
    known = from_array(message.condition_number, field="condition_number") > 0.0
    frf = np.where(known[:, None, None], from_array(message.frf, field="frf"), 0.0)
    lines = from_array(message.frequency, field="frequency") <= 35.0
    drives, responses = (from_array(getattr(message, name), field=name) for name in ("drive_psd", "response_psd"))
    caused = np.sum(np.abs(frf[lines]) ** 2 * drives[lines][:, None, :], axis=0)
    expected = np.sqrt(caused / responses[lines].sum(axis=0)[:, None])
    np.testing.assert_allclose(contributions(Model.from_message(message), (0.0, 35.0)), expected)


def test_every_variable_says_what_it_is_and_in_which_unit(message):
    model = Model.from_message(message).to_xarray()
    assert model.frf.attrs["units"] == model.frf_deviation.attrs["units"] == "N/m"
    assert "of the drives' cross-spectrum" in model.condition_number.attrs["long_name"]
    assert model.condition_number.attrs["units"] == model.coherence.attrs["units"] == "1"
    assert set(model.response_unit.values) == {"N"}


def test_elements_of_several_units_have_theirs_in_coordinates(message):
    message.responses[2].unit = "m/s²"
    frf = Model.from_message(message).to_xarray().frf
    assert frf.attrs["units"] == "response_unit/drive_unit"
    element = frf.sel(response=message.responses[2].name, drive=message.drives[0].name)
    assert (element.response_unit.item(), element.drive_unit.item()) == ("m/s²", "m")


def test_a_model_says_which_drives_follow_which(message):
    assert "Drive map" not in str(Model.from_message(message))
    message.drive_map.terms.add(sentence="lateral follows −1.71 /m × vertical²")
    model = Model.from_message(message)
    assert model.drive_map == ("lateral follows −1.71 /m × vertical²",)
    assert "- Drive map: lateral follows −1.71 /m × vertical²." in str(model)
    assert "Drive map: lateral follows −1.71 /m × vertical²." in model._repr_html_()
