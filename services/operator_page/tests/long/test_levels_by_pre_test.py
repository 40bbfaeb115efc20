"""Levels of an identification by the pulses of a pre-test, over HTTP."""

import numpy as np
from page_lab import RIG, Client, campaign, some_drive, write_target


def test_levels_follow_from_the_newest_passed_pre_test_and_the_target(page_lab):
    page = page_lab.page("levels")
    client = Client(page.address)
    write_target(page.files / "target.rsp", page_lab.rig)
    document = campaign("levels", control_band={"lowest_frequency": 1.0, "highest_frequency": 35.0})
    status, answer = client.post("/api/pre_test_levels", {"document": document})
    assert (status, answer["error"]) == (
        400,
        f"There is no passed pre-test of {RIG} in this lab; make one on the screen Rig.",
    )
    for name in ("older", "newer"):
        page_lab.lab.pre_test(RIG, id=name, level=0.01)
    status, answer = client.post("/api/pre_test_levels", {"document": document})
    assert (status, answer["pre_test"]) == (200, "newer")
    share = np.array(list(answer["excitation"]["rms"].values())) / some_drive(6000).std(axis=1)
    assert np.all((share > 0.2) & (share < 0.6)), share
    changed = document | {"excitation": answer["excitation"], "estimator": answer["estimator"]}
    status, answer = client.post("/api/campaign_files", {"document": changed})
    assert status == 200, answer
    road = campaign("levels", target={"road": {"iso_class": "C", "seed": 1, "duration": 9.0}, "vehicle": "v"})
    assert "give a measured file" in client.post("/api/pre_test_levels", {"document": road})[1]["error"]
