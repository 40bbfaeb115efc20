"""The page as `duralab up --page` and `duralab run --page` start it: beside the lab, and again where it was killed."""

import os
import signal
import subprocess
import sys
import time

import pytest
import yaml
from page_lab import RIG, Client, PageLab, campaign, write_target

from duralab.errors import InputError
from duralab.processes import OperatorPage

pytestmark = pytest.mark.timeout(300)


def answers(address, seconds=60.0):
    end = time.monotonic() + seconds
    while True:
        try:
            return Client(address)
        except OSError:
            assert time.monotonic() < end
            time.sleep(0.1)


def test_a_page_that_was_killed_comes_back_at_its_address_and_ends_with_its_lab(page_lab, tmp_path):
    with OperatorPage(page_lab.lab.endpoints[0], folder=tmp_path / "page", log=tmp_path / "page.log") as page:
        assert answers(page.address).wait_for(lambda lab: lab["rigs"])["rigs"][0]["name"] == RIG
        first = page.process_id
        os.kill(first, signal.SIGKILL)
        assert answers(page.address).wait_for(lambda lab: lab["rigs"])["rigs"][0]["name"] == RIG
        last = page.process_id
        assert last != first
        assert page_lab.lab.failure() is None
    with pytest.raises(OSError, match=r"[Cc]onnection"):
        Client(page.address)


def test_a_port_that_is_taken_is_refused_in_a_sentence(page_lab, tmp_path):
    with OperatorPage(page_lab.lab.endpoints[0], folder=tmp_path / "page", log=tmp_path / "page.log") as page:
        port = int(page.address.rstrip("/").rpartition(":")[2])
        with pytest.raises(InputError, match=f"The port {port} of 127.0.0.1 is in use"):
            OperatorPage(page_lab.lab.endpoints[0], folder=tmp_path / "b", log=tmp_path / "b.log", port=port)


def test_the_command_line_says_where_the_page_of_a_lab_is_and_refuses_one_of_another_lab(tmp_path):
    lab = PageLab(tmp_path)
    write_target(tmp_path / "target.rsp", lab.rig)
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(campaign()))
    command = [sys.executable, "-m", "duralab", "run", "c.yaml", "--page", "--connect", "tcp/127.0.0.1:1"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert (
        "--page is an option of the lab: start the lab at --connect with `duralab up --page`."
        in done.stderr.replace("\n", " ")
    )
    command = [
        sys.executable,
        "-m",
        "duralab",
        "up",
        "--page",
        "--listen",
        "tcp/127.0.0.1:0",
        "--rig",
        "front_axle_compliant",
    ]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as up:
        try:
            assert up.stdout is not None
            line = next(line for line in up.stdout if line.startswith("Operator page: "))
            client = answers(line.split()[2])
            assert client.wait_for(lambda lab: lab["rigs"])["rigs"][0]["name"] == "front_axle_compliant"
        finally:
            up.send_signal(signal.SIGINT)
            up.stdout.read()
            up.wait(30.0)
    with pytest.raises(OSError, match=r"[Cc]onnection"):
        client.open()
