"""A thousand malformed requests for each endpoint: refused in a sentence, nothing moves, the page lives on."""

import json
import random

import pytest
from malformed_requests import REQUESTS, malformed, raw
from page_lab import RIG, Client

from .test_page_over_http import COMMANDS, READS

pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def page(page_lab):
    return page_lab.page("malformed")


@pytest.mark.parametrize("path", list(COMMANDS))
def test_no_malformed_command_is_carried_out_or_answered_without_a_sentence(page_lab, page, path):
    random_one, values = random.Random(path), COMMANDS[path][0]
    client = Client(page.address)
    statuses = set()
    # Each file that is taken is read by a process of its own, which takes seconds.
    for number in range(20 if path.startswith("/api/uploads") else REQUESTS):
        if number % 80 == 0:
            # A session of its own each time: what is tried here is no rate.
            client = Client(page.address)
            client.cookie = ""
            client.open()
        headers = {
            "Content-Type": random_one.choice(["application/json"] * 8 + ["text/plain", ""]),
            "X-Duralab-Page": random_one.choice([client.version] * 8 + ["", "0"]),
            "X-Duralab-Token": random_one.choice([client.token] * 8 + ["", "é".encode().decode("latin-1")]),
            "Cookie": f"duralab_session={random_one.choice([client.cookie] * 8 + ['', 'x'])}",
        }
        status, content = raw(client, "POST", path, malformed(random_one, values), headers)
        statuses.add(status)
        assert status < 500, (status, content)
        if status >= 400:
            assert json.loads(content)["error"].endswith((".", "?", "!")), content
        else:
            # Only what needs no second act and has no wrong value: a stop, a release, an upload that is refused later.
            assert path.endswith(("/stop", "/release")) or path == "/api/stop", (path, content)
    assert statuses & {400, 403, 409}
    assert page.process.poll() is None
    assert not [line for line in page.log if line.get("level") == "error"]
    assert page_lab.lab.state(RIG).run == ""


@pytest.mark.parametrize("path", READS[1:])
def test_no_malformed_question_is_answered_without_a_sentence(page, path):
    random_one = random.Random(path)
    client = Client(page.address)
    for number in range(REQUESTS):
        if number % 80 == 0:
            client = Client(page.address)
            client.cookie = ""
            client.open()
        parts = path.split("/")
        parts[random_one.randrange(2, len(parts))] = random_one.choice(
            ["%00", "..", "%2e", "*", "a%20b", "@head", "x" * 500]
        )
        query = random_one.choice(["", "?rig=%ff", "?result=x", "?id=" + "a" * 4000, "?&&=;"])
        status, content = raw(
            client, "GET", "/".join(parts) + query, b"", {"Cookie": f"duralab_session={client.cookie}"}
        )
        assert status < 500, (path, status, content)
    assert page.process.poll() is None
    assert not [line for line in page.log if line.get("level") == "error"]
