# SPDX-License-Identifier: Apache-2.0
"""What `urgengo trace export --perfetto` writes, read by Perfetto's own decoder (PyPI's perfetto).

argv: urgengo_run_trace_tests, which writes the trace of one late frame, and the folder in which
tools/test has installed the package. Where it is missing this says so and exits with 77: the same
file is read with protozero by test_run_export.cpp.
"""
import os
import subprocess
import sys
import tempfile

PYTHON = os.path.join(sys.argv[2], "bin", "python3")
if os.path.exists(PYTHON) and os.path.abspath(sys.prefix) != os.path.abspath(sys.argv[2]):
    os.execv(PYTHON, [PYTHON, *sys.argv])
try:
    from perfetto.protos.perfetto.trace import perfetto_trace_pb2 as pb
except ImportError as error:
    print(f"skipped: {error}; tools/test installs it where it can, and says why where it cannot")
    sys.exit(77)

MS = 1_000_000
with tempfile.TemporaryDirectory() as folder:
    path = os.path.join(folder, "late.perfetto")
    subprocess.run([sys.argv[1], "[perfetto_file]"], check=True, stdout=subprocess.DEVNULL,
                   env={**os.environ, "URGENGO_TEST_PERFETTO": path})
    trace = pb.Trace()
    with open(path, "rb") as file:
        trace.ParseFromString(file.read())

tracks = {p.track_descriptor.uuid: p.track_descriptor for p in trace.packet
          if p.HasField("track_descriptor")}
names = {uuid: (tracks[t.parent_uuid].name + "/" if t.parent_uuid in tracks else "") + t.name
         for uuid, t in tracks.items()}
assert all(not t.parent_uuid or t.parent_uuid in tracks for t in tracks.values())
snapshot = [p.clock_snapshot for p in trace.packet if p.HasField("clock_snapshot")]
assert {s.primary_trace_clock for s in snapshot} == {pb.BuiltinClock.BUILTIN_CLOCK_MONOTONIC}
assert [{c.clock_id for c in s.clocks} for s in snapshot] == [{1, 3}, {3, 64}], snapshot
assert [c.timestamp for c in snapshot[1].clocks] == [1068 * MS, 5 * MS]

events = [(p.timestamp, names[p.track_event.track_uuid], p.track_event) for p in trace.packet
          if p.HasField("track_event")]
assert [e[0] for e in events] == sorted(e[0] for e in events)
depth = {}
for _, track, event in events:
    depth.setdefault(track, 0)
    depth[track] += {1: 1, 2: -1}.get(event.type, 0)
    assert 0 <= depth[track] <= 1, track
assert set(depth.values()) == {0}

begins = {track: (time, event) for time, track, event in events if event.type == 1}
time, frame = begins["lidar/frames"]
assert (time, frame.name) == (1000 * MS, "lidar #17 late"), frame
texts = {a.name: a.string_value for a in frame.debug_annotations}
assert texts["cause"] == "held behind camera", texts
time, hold = begins["lidar/detect: held"]
assert time == 1006 * MS and hold.name == "held behind camera"
assert list(hold.terminating_flow_ids) == list(begins["camera/detect: GPU"][1].flow_ids) != []
on_stream = [(time, event.name) for time, track, event in events if track == "streams/stream 2"]
assert on_stream == [(1005 * MS, "lidar/detect: launches 0..2"), (1069 * MS, ""),
                     (1069 * MS, "lidar/detect: launches 3..4"), (1091 * MS, "")], on_stream
counters = {track: event.double_counter_value for _, track, event in events if event.type == 4}
assert counters == {"lidar/detect: kernel": 3, "lidar/detect: laxity": -5,
                    "lidar/detect: held so far": 50}, counters
assert {t.counter.unit_name for t in tracks.values() if t.HasField("counter")} == {"", "ms"}
print("read", len(trace.packet), "packets")
