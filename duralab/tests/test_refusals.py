"""Who was refused what, read from lines as a router of Zenoh 1.10.2 writes them."""

import json

from typer.testing import CliRunner

from duralab.cli.application import app
from duralab.security import read_refusals
from duralab.security.router_log import Refusal

ACCESS = "zenoh::net::routing::interceptor::access_control"
VIEWER = "9c68 on Interface(lo)+CertCommonName(viewer.main)+Transport(Tls)+9c68"
QUESTIONS = ("Query", "Reply", "Put", "Delete", "Declare/Undeclare Subscriber", "Declare/Undeclare Queryable")


def line(text, *, thread="rx-1 ThreadId(09)", target=ACCESS):
    return f"2026-11-21T17:02:28.522144Z TRACE  {thread} {target}: {text}\n"


def in_advance(key, **where):
    """Return what is looked up of a key in advance: nobody tried it."""
    asked = [*QUESTIONS, "Declare/Undeclare Liveliness Token", "Liveliness Query", "Declare Liveliness Subscriber"]
    return [
        line(f"ACL (ingress): caching permissions for `{key}` ...", **where),
        *(line(f"{VIEWER} is unauthorized to {what} (ingress) on {key}", **where) for what in asked),
    ]


def test_an_attempt_is_told_with_who_session_what_and_key():
    (refusal,) = read_refusals([line(f"{VIEWER} is unauthorized to Query (ingress) on duralab/v1/local/rig/a/play")])
    assert refusal == Refusal(
        "2026-11-21T17:02:28.522144Z", "viewer.main", "9c68", "Query", "duralab/v1/local/rig/a/play"
    )


def test_what_is_looked_up_in_advance_is_no_attempt_but_what_follows_from_it_is():
    cached = line("Using cached result: 9c68 is unauthorized to Put (ingress) on a/b")
    assert [(r.who, r.what) for r in read_refusals([*in_advance("a/b"), cached])] == [("viewer.main", "Put")]


def test_an_attempt_on_another_thread_in_between_is_told():
    lines = in_advance("a/b")
    lines.insert(4, line(f"{VIEWER} is unauthorized to Put (ingress) on c", thread="rx-0 ThreadId(08)"))
    assert [r.key for r in read_refusals(lines)] == ["c"]


def test_what_is_allowed_or_withheld_from_a_receiver_is_no_refusal():
    lines = [
        line(f"{VIEWER} is authorized to Query (ingress) on a"),
        line(f"{VIEWER} is unauthorized to Declare Queryable (egress) on a"),
        "something else altogether\n",
    ]
    assert list(read_refusals(lines)) == []


def test_links_that_did_not_come_so_far_are_told_without_a_name():
    lines = [
        line(
            "received fatal alert: UnknownCA. Hint: increase the system open file limit.",
            target="zenoh_link_tls::unicast",
        ),
        line(
            "9c68 did not match any configured ACL subject. Default permission `Deny` will be applied on all messages"
        ),
    ]
    assert [(r.who, r.what, r.session) for r in read_refusals(lines)] == [("", "join", ""), ("", "join", "9c68")]


def test_colours_of_a_terminal_do_not_hide_anything():
    coloured = line(f"{VIEWER} is unauthorized to Put (ingress) on a").replace("TRACE", "\x1b[35mTRACE\x1b[0m")
    assert [r.who for r in read_refusals([coloured])] == ["viewer.main"]


def test_the_command_prints_one_line_or_object_each(tmp_path):
    log = tmp_path / "router.log"
    log.write_text(line(f"{VIEWER} is unauthorized to Put (ingress) on a"))
    plain = CliRunner().invoke(app, ["certs", "refusals", str(log)])
    assert plain.stdout == "2026-11-21T17:02:28.522144Z viewer.main (session 9c68): Put: a\n"
    as_json = CliRunner().invoke(app, ["certs", "refusals", "--json"], input=log.read_text())
    assert json.loads(as_json.stdout)["who"] == "viewer.main"
    missing = CliRunner().invoke(app, ["certs", "refusals", str(tmp_path / "none.log")])
    assert missing.exit_code == 2
