"""Keys: names come back out of the keys they went into, and bad names never get in."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from duralab_proto import keys
from duralab_proto.keys import Keys

RIGS = st.from_regex(r"[a-z0-9][a-z0-9_]{0,30}", fullmatch=True)
RUNS = st.from_regex(r"[a-z0-9][a-z0-9_.-]{0,30}", fullmatch=True)
IDS = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,30}", fullmatch=True).filter(lambda name: name not in {"start", "list"})
LABS = st.from_regex(r"[a-z0-9_-]{1,20}", fullmatch=True)


@given(LABS, RIGS, RUNS)
def test_rig_and_run_come_back_out_of_a_signal_key(lab, rig, run):
    key = Keys(lab).rig_signal(rig, run)
    assert keys.rig_of(key) == rig
    assert keys.run_of(key) == run
    assert key.startswith(f"duralab/v1/{lab}/rig/")


@given(LABS, IDS)
def test_id_comes_back_out_of_every_key_that_holds_one(lab, name):
    k = Keys(lab)
    for key in (
        k.model(name),
        k.prediction(name),
        k.convergence(name),
        k.campaign(name),
        k.campaign_stop(name),
        k.campaign_resume(name, "beam"),
        k.campaign_decide(name, "beam"),
        k.campaign_event(name),
        k.endurance(name),
        k.endurance_stop(name),
        k.endurance_hold(name),
        k.endurance_resume(name, "beam"),
        k.endurance_decide(name, "beam"),
        k.endurance_event(name),
        k.recording(name),
        k.recording_read(name),
        k.recording_steps(name),
        k.recording_verify(name),
    ):
        assert keys.id_of(key) == name


@given(LABS, RIGS, IDS)
def test_rig_comes_back_out_of_every_query_that_moves_one(lab, rig, id):
    k = Keys(lab)
    moving = (k.rig_play(rig), k.rig_reset(rig), k.identify(rig), k.identify_levels(rig), k.campaign_start(rig))
    endurance = (k.endurance_start(rig), k.endurance_resume(id, rig), k.endurance_decide(id, rig))
    for key in (*moving, *endurance, k.pre_test(rig), k.campaign_resume(id, rig), k.campaign_decide(id, rig)):
        assert keys.rig_of(key) == rig


@given(LABS, RIGS.filter(lambda name: name not in {"start", "list"}))
def test_project_comes_back_out_of_the_key_of_its_recordings(lab, project):
    assert keys.project_of(Keys(lab).project_recordings(project)) == project


@pytest.mark.parametrize(
    ("id", "belongs"),
    [("wheel", True), ("wheel-2", True), ("wheel-pave-2", True), ("wheels", False), ("wheel_a", False)],
)
def test_a_campaign_is_of_the_project_that_its_id_begins_with(id, belongs):
    assert keys.in_project(id, "wheel") is belongs


@given(LABS, RIGS, IDS)
def test_live_key_is_taken_apart_again(lab, service, instance):
    assert keys.parse_live(Keys(lab).live(service, instance)) == (service, instance)


@given(st.text(max_size=40))
def test_any_text_is_a_safe_single_chunk_or_refused(name):
    # Whatever a user types, a key that is made keeps its shape: no further chunk, wildcard or parameter slips in.
    makers = [(Keys().rig_play, 6), (lambda n: Keys().rig_signal("rig", n), 7), (Keys().recording, 6)]
    for make, chunks in makers:
        with contextlib.suppress(ValueError):
            key = make(name)
            assert len(key.split("/")) == chunks
            assert name in {"*", "**"} or not set("*$?#@ \n") & set(key)


@pytest.mark.parametrize("lab", ["", "Local", "a/b", "*", "a b", "ä", "a\n"])
def test_bad_lab_is_refused(lab):
    with pytest.raises(ValueError, match="lab"):
        Keys(lab)


@pytest.mark.parametrize("make", [Keys().campaign, Keys().recording, Keys().model])
@pytest.mark.parametrize("name", ["start", "list"])
def test_ids_that_the_contract_uses_itself_are_refused(make, name):
    with pytest.raises(ValueError, match="taken"):
        make(name)


def test_name_too_long_for_a_file_is_refused():
    with pytest.raises(ValueError, match="121 characters; at most 120"):
        Keys().campaign("x" * 121)


@pytest.mark.parametrize(
    ("key", "live"),
    [
        (Keys("l").rig_play("front_axle"), "live/rig_sim/front_axle"),
        (Keys("l").rig_state("predecessor"), "live/rig_sim/predecessor"),
        (Keys("l").rig_frf("aerospace"), "live/rig_sim/aerospace"),
        (Keys("l").identify("beam"), "live/identifier/main"),
        (Keys("l").model("abc"), "live/identifier/main"),
        (Keys("l").campaign_start("beam"), "live/iterator/main"),
        (Keys("l").campaign_stop("abc"), "live/iterator/main"),
        (Keys("l").commit(), "live/recorder/main"),
        (Keys("l").recordings(), "live/recorder/main"),
        (Keys("l").health("rig_sim", "front_axle"), "live/rig_sim/front_axle"),
        (Keys("l").endurance_start("beam"), "live/sequencer/main"),
        (Keys("l").health("iterator", "main"), "live/iterator/main"),
    ],
)
def test_serving_names_the_token_of_who_answers(key, live):
    assert keys.serving(key) == f"duralab/v1/l/{live}"


@pytest.mark.parametrize("key", ["", "duralab/v1/l", "duralab/v2/l/rig/a/play", "duralab/v1/l/other/a", "x/y/z/rig/a"])
def test_key_of_nobody_is_refused(key):
    with pytest.raises(ValueError, match="key"):
        keys.serving(key)


def test_streams_without_end_are_one_family():
    lab = keys.Keys("lab-1")
    assert keys.stream_family(lab.rig_signal("front_axle", "demo.i01")) == lab.rig_signal("front_axle", keys.ANY)
    assert keys.stream_family(lab.campaign_event("demo")) == lab.campaign_event(keys.ANY)
    for key in (lab.rig_pose("front_axle"), lab.rig_state("signal"), lab.commit(), lab.campaign("event"), "any/other"):
        assert keys.stream_family(key) == key


@pytest.mark.parametrize("parse", [keys.rig_of, keys.run_of, keys.id_of, keys.project_of, keys.parse_live])
def test_key_without_the_name_asked_for_is_refused(parse):
    with pytest.raises(ValueError, match="names no"):
        parse(Keys().commit())
