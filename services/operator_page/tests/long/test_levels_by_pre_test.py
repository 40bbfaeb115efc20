"""Levels of an identification by the pulses of a pre-test, over HTTP."""

import numpy as np
from page_lab import RIG, Client, campaign, some_drive, write_target

import duralab


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
    page_lab.lab.pre_test(RIG, id="older", level=0.02)
    assert client.act(f"/api/rigs/{RIG}/pre_test", {"level": 0.2})[0] == 400
    assert client.act(f"/api/rigs/{RIG}/pre_test", {"level": 0.01})[0] == 200
    said = f"The pre-test of {RIG} is passed."
    client.wait_for(lambda lab: any(line["text"] == said for line in lab["log"]))
    status, answer = client.post("/api/pre_test_levels", {"document": document})
    assert (status, answer["pre_test"] != "older") == (200, True)
    newest = page_lab.lab.catalogue.fetch(answer["pre_test"], page_lab.folder / "newest")
    # 1 % of 0.1 m.
    np.testing.assert_allclose(duralab.open_recording(newest).pre_test.amplitude, 0.001)
    share = np.array(list(answer["excitation"]["rms"].values())) / some_drive(6000).std(axis=1)
    assert np.all((share > 0.2) & (share < 0.6)), share
    changed = document | {"excitation": answer["excitation"], "estimator": answer["estimator"]}
    status, answer = client.post("/api/campaign_files", {"document": changed})
    assert status == 200, answer
    road = campaign("levels", target={"road": {"iso_class": "C", "seed": 1, "duration": 9.0}, "vehicle": "v"})
    assert "give a measured file" in client.post("/api/pre_test_levels", {"document": road})[1]["error"]
