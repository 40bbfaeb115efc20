"""Commits steps without end into the folder it is given, and tells on stderr which were acknowledged."""

from __future__ import annotations

import sys
from pathlib import Path

from duralab_proto.v1 import iterator_pb2, recorder_pb2
from recorder.format import decode_step
from recorder.log import Archive


def main() -> None:
    archive = Archive(Path(sys.argv[1]), least_free_bytes=0)
    for number in range(100_000):
        status = iterator_pb2.CampaignStatus(id="demo", activity="x" * (number % 2000))
        request = recorder_pb2.CommitRequest(
            recording="demo",
            step=number,
            message_type=status.DESCRIPTOR.full_name,
            payload=status.SerializeToString(),
        )
        archive.commit("demo", decode_step(request))
        sys.stderr.write(f"{number}\n")
        sys.stderr.flush()


if __name__ == "__main__":
    main()
