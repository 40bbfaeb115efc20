"""How commands end where their terminal, their reader or the system's processes are gone."""

import os
import pty
import re
import select
import shutil
import signal
import subprocess
import time
import traceback
from pathlib import Path

import psutil
import pytest
from ended_processes import wait_until_gone
from test_cli import COMMAND, finish, quick, services_of

from duralab.errors import PROCESS_LIMIT
from duralab.processes.supervisor import last_lines

OTHER_USER = 54_321
"""A user without processes: the limit is one of all processes of a user, and there is none for root."""


class Terminal:
    """A command as the first process of a terminal, as a terminal's window starts a shell."""

    def __init__(self, *arguments, cwd, ignoring=()):
        self.pid, self._master = pty.fork()
        if self.pid == 0:
            for number in ignoring:
                signal.signal(number, signal.SIG_IGN)
            os.chdir(cwd)
            os.execv(COMMAND[0], [*COMMAND, *map(str, arguments)])

    def read_until(self, part, *, seconds=60.0):
        shown, deadline = "", time.monotonic() + seconds
        while part not in shown:
            assert time.monotonic() < deadline, shown
            if select.select([self._master], [], [], 0.1)[0]:
                shown += os.read(self._master, 4096).decode(errors="replace")
        return shown

    def close(self):
        os.close(self._master)

    def exit_code(self, *, seconds=60.0):
        deadline = time.monotonic() + seconds
        while (ended := os.waitpid(self.pid, os.WNOHANG))[0] == 0:
            if time.monotonic() > deadline:
                os.kill(self.pid, signal.SIGKILL)
                os.waitpid(self.pid, 0)
                pytest.fail(f"did not end within {seconds} s")
            time.sleep(0.02)
        return os.waitstatus_to_exitcode(ended[1])


@pytest.mark.parametrize("arguments", [["run", "mine.yaml", "--out", "out"], ["up", "--listen", "tcp/127.0.0.1:0"]])
def test_a_closed_terminal_ends_a_command_as_the_table_of_exit_codes_says(
    fake_services, tmp_path, monkeypatch, arguments
):
    monkeypatch.setenv("FAKE_ITERATOR", "stay")
    monkeypatch.setenv("FAKE_STOPPED", str(tmp_path / "stopped"))
    quick(tmp_path)
    terminal = Terminal(*arguments, cwd=tmp_path)
    terminal.read_until("identifying the rig" if arguments[0] == "run" else "The lab is up")
    started = services_of(terminal.pid)
    # `up` starts the sequencer too.
    assert len(started) == (5 if arguments[0] == "up" else 4)
    terminal.close()
    assert terminal.exit_code() == 143
    assert wait_until_gone(started, seconds=0.0) == []
    if arguments[0] == "run":
        assert (tmp_path / "stopped").read_text() == "interrupted by the user"
        assert (tmp_path / "out" / "recording.mcap").is_file()


def test_nohup_is_obeyed_and_an_error_without_a_terminal_keeps_its_exit_code(fake_services, tmp_path):
    terminal = Terminal("up", "--listen", "tcp/127.0.0.1:0", cwd=tmp_path, ignoring=[signal.SIGHUP])
    terminal.read_until("duralab down")
    started = services_of(terminal.pid)
    terminal.close()
    state = Path(f"/proc/{terminal.pid}/status").read_text()
    assert int(re.search(r"SigIgn:\s*(\w+)", state)[1], 16) & 1 << signal.SIGHUP - 1
    # The lab still watches its services. The message of the one that dies has no terminal any more.
    os.kill(started[0], signal.SIGKILL)
    assert terminal.exit_code() == 1
    assert wait_until_gone(started, seconds=0.0) == []


# A shell tells the same of a tool that SIGPIPE ended; a mistake keeps its own code.
@pytest.mark.parametrize(("arguments", "code"), [(["--help"], 141), (["report", "nowhere.mcap", "--json"], 2)])
def test_a_reader_that_is_gone_is_no_traceback(tmp_path, arguments, code):
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "wb") as gone:
        done = subprocess.run(
            [*COMMAND, *arguments], cwd=tmp_path, stdout=gone, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == code
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert done.stderr.count("\n") <= 1


def threads_of(user):
    """Return the number of threads that count against a user's limit."""
    return sum(
        process.info["num_threads"] or 0
        for process in psutil.process_iter(["uids", "num_threads"])
        if process.info["uids"] is not None and process.info["uids"].real == user
    )


def limited(count, folder):
    """Return what goes before a command so that it may start only so many threads, itself and its services included."""
    if os.geteuid() != 0:
        return ["prlimit", f"--nproc={threads_of(os.geteuid()) + count}"]
    # Root has no limit: another user has it, who may read what belongs to root.
    os.chown(folder, OTHER_USER, -1)
    capabilities = "+dac_override,+dac_read_search"
    as_other = ["setpriv", f"--reuid={OTHER_USER}", f"--inh-caps={capabilities}", f"--ambient-caps={capabilities}"]
    return [*as_other, "prlimit", f"--nproc={count}"]


@pytest.mark.skipif(not (shutil.which("setpriv") and shutil.which("prlimit")), reason="needs util-linux")
@pytest.mark.parametrize("threads", [10, 30])
def test_a_limit_of_processes_is_one_sentence(tmp_path, threads):
    """The first limit is met by the command, mostly before it starts a service, the second by a service."""
    process = subprocess.Popen(
        [*limited(threads, tmp_path), *COMMAND, "run", "front_axle_demo", "--out", "out"],
        cwd=tmp_path,
        env={**os.environ, "HOME": str(tmp_path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    code, _, stderr = finish(process)
    assert code == 1
    assert "File" not in stderr
    # The command's own Zenoh may meet the limit as well: its thread then writes a Rust trace before the sentence.
    *before, sentence = stderr.splitlines()
    # Which thread is one too many depends on their order, which the system chooses: each has its own sentence.
    assert re.fullmatch(
        r"Error: (A process or thread of this command could not be started: "
        r"|The process of the service \w+ could not be started: "
        r"|The service \w+ .*: it could not start a thread, )" + re.escape(PROCESS_LIMIT) + r"(\.|; its log is .*)",
        sentence,
    ), sentence
    assert not before or "can't spawn worker thread" in stderr


def test_of_a_stack_trace_in_a_log_only_the_message_is_told(tmp_path):
    log = tmp_path / "service.log"
    try:
        try:
            raise ValueError("no oil")
        except ValueError as error:
            raise RuntimeError("no pressure") from error
    except RuntimeError as error:
        log.write_text("ready\n" + "".join(traceback.format_exception(error)))
    assert last_lines(log) == "ready / ValueError: no oil / RuntimeError: no pressure"
