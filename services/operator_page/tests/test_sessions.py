"""Sessions end, rates have limits, a motion needs two acts, a rig one holder."""

import pytest

from operator_page.accounts import PageRole
from operator_page.deliberation import ARMED_SECONDS, Arming, Holders
from operator_page.sessions import MOST_SESSIONS, RateLimit, Sessions


class Clock:
    now = 1000.0

    def __call__(self):
        return self.now


def test_a_session_is_found_by_its_cookie_until_it_ends():
    clock = Clock()
    sessions = Sessions(60.0, clock=clock)
    cookie, session = sessions.begin("Ada", PageRole.OPERATOR)
    other, _ = sessions.begin("Ada", PageRole.OPERATOR)
    assert sessions.find(cookie) is session
    assert sessions.find(cookie[:-1]) is None
    assert sessions.find("") is None
    assert session.is_own(session.token)
    assert not session.is_own("")
    clock.now += 59.0
    assert sessions.find(cookie) is session
    sessions.end(other)
    assert sessions.find(other) is None
    # Of a certificate that expires before: it ends with that.
    short, _ = sessions.begin("Ada", PageRole.OPERATOR, seconds=0.5)
    clock.now += 0.4
    assert sessions.find(short) is not None
    clock.now += 0.2
    assert sessions.find(short) is None
    clock.now -= 0.6
    clock.now += 1.0
    assert sessions.find(cookie) is None


def test_sessions_are_bounded_and_the_one_that_was_idle_longest_goes():
    clock = Clock()
    sessions = Sessions(60.0, clock=clock)
    cookies = []
    for _ in range(MOST_SESSIONS):
        clock.now += 0.001
        cookies.append(sessions.begin("Ada", PageRole.VIEWER)[0])
    clock.now += 1.0
    assert sessions.find(cookies[0]) is not None
    sessions.begin("Grace", PageRole.VIEWER)
    assert len(sessions) == MOST_SESSIONS
    assert sessions.find(cookies[0]) is not None
    assert sessions.find(cookies[1]) is None


def test_a_rate_has_a_burst_and_recovers():
    clock = Clock()
    limit = RateLimit(3, 0.5, clock=clock)
    assert [limit.allows("a") for _ in range(4)] == [True, True, True, False]
    assert limit.allows("b")
    clock.now += 2.0
    assert limit.allows("a", cost=0)
    assert [limit.allows("a") for _ in range(2)] == [True, False]
    assert not limit.allows("a", cost=0)


def test_an_armed_action_is_done_once_by_its_own_session_with_its_own_values_in_time():
    clock = Clock()
    arming = Arming(clock=clock)
    values = {"b": 1, "a": [2]}
    word = arming.arm("ada", "/api/x", values)
    assert arming.use(word, "ada", "/api/x", {"a": [2], "b": 1})
    assert not arming.use(word, "ada", "/api/x", values)
    for who, action, given in (("eve", "/api/x", values), ("ada", "/api/y", values), ("ada", "/api/x", {"b": 2})):
        assert not arming.use(arming.arm("ada", "/api/x", values), who, action, given)
    word = arming.arm("ada", "/api/x", values)
    clock.now += ARMED_SECONDS
    assert not arming.use(word, "ada", "/api/x", values)


def test_a_rig_is_held_by_the_first_until_another_takes_it():
    holders = Holders()
    holders.require("Ada", "rig")
    holders.require("Ada", "rig")
    with pytest.raises(PermissionError, match="Ada holds the rig rig; ask Ada, or take the rig over first"):
        holders.require("Grace", "rig")
    before = holders.take("rig", "Grace")
    assert before is not None
    assert before.name == "Ada"
    holders.require("Grace", "rig")
    assert not holders.release("rig", "Ada")
    assert holders.release("rig", "Grace")
    assert holders.of("rig") is None


def test_several_rigs_are_held_together_or_not_at_all():
    holders = Holders()
    holders.require("Grace", "vehicle")
    with pytest.raises(PermissionError, match="Grace holds the rig vehicle"):
        holders.require("Ada", "rig", "vehicle")
    assert holders.of("rig") is None
    assert holders.require("Grace", "rig", "vehicle") == ["rig"]
