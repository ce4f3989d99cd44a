#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks what no compiler checks: layering, the driver boundary, and that documentation is true."""
import json
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
LAYERS = ["base", "config", "model", "progress", "sched", "observe", "exec", "identity",
          "runtime"]
MAX_README_LINES = 150
# What a result must say of itself: one key of each. And results of which it is not known any more.
RESULT_HEAD = {"command": ("command_line", "command_lines"), "commit": ("commit",),
               "driver": ("driver",), "GPU": ("gpu",), "date": ("date_utc",)}
INCOMPLETE_RESULTS = {
    # urgengo_copy_bench did not write them; the folder's H200 had driver 580.159.04 that day.
    "2026-11-22_h200_copies.json": {"commit", "driver"},
    # Programs that were thrown away; the results say in words what they did.
    "2026-11-22_h200_mark_micro.json": {"command", "commit"},
    "2026-11-23_h200_driver_place.json": {"command"},
}
MAX_SOURCE_LINES = 400
SOURCES = {".h", ".cpp", ".cu", ".cuh", ".c"}
problems = []


def sources(*folders):
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in SOURCES and "generated" not in path.parts:
                yield path, path.read_text()


def report(path, line, message):
    problems.append(f"{path.relative_to(ROOT)}:{line}: {message}")


def lines(text):
    """Numbered lines without comments."""
    for number, line in enumerate(text.splitlines(), 1):
        yield number, line.split("//")[0]


def check_layers():
    for path, text in sources("host"):
        layer = LAYERS.index(path.relative_to(ROOT / "host").parts[0])
        for number, line in lines(text):
            match = re.match(r'\s*#include "host/(\w+)/', line)
            if match and LAYERS.index(match[1]) > layer:
                report(path, number, f"includes upwards: {LAYERS[layer]} must not know {match[1]}")
            if layer < LAYERS.index("exec") and re.match(r'\s*#include <cuda', line):
                report(path, number, "includes CUDA below exec/")


def check_boundary():
    bare_call = re.compile(r"(?<![\w.>:])(cu[A-Z]\w+)\(")
    for path, text in sources("host", "interposer"):
        for number, line in lines(text):
            if re.search(r"\b(exit|abort|terminate)\(", line):
                report(path, number, "must never end the program")
            if "std::cout" in line or re.search(r"\bprintf\(", line):
                report(path, number, "must never write to stdout")
            match = bare_call.search(line)
            if match and "CUDAAPI" not in line:
                report(path, number, f"calls {match[1]} without real()")


def check_messages():
    """Tools say what they say by tools/log/log.h; what is loaded into programs does not know it."""
    others = ("tools/simgpu/", "tools/bench/cupti_kernels.cpp", "tools/urgengo/progress_bar.cpp")
    for path, text in sources("tools"):
        if str(path.relative_to(ROOT)).startswith(others):
            continue
        for number, line in lines(text):
            if re.search(r"[(,] ?stderr[,)]|std::c(err|log)\b", line):
                report(path, number, "writes to stderr without tools/log/log.h")
    for path, text in sources("host", "interposer", "tools/simgpu"):
        for number, line in lines(text):
            if re.search(r'#include [<"](spdlog|tools/log)/', line):
                report(path, number, "includes the tools' log: it is loaded into programs")


def check_words():
    """Comments name who is meant, by the glossary of host/README.md: a task, a thread, a bystander."""
    riddles = re.compile(r"\b(nobody|somebody|anybody|whoever|who comes|who is at)\b", re.I)
    for path, text in sources("host", "interposer", "device", "tools"):
        for number, line in enumerate(text.splitlines(), 1):
            # `nobody` is a key of results.
            if match := riddles.search(line.partition("//")[2].replace("`nobody`", "")):
                report(path, number, f"says '{match[0]}' in a comment: name the task or thread")


def check_headers():
    for path, text in sources("include", "host", "device", "interposer", "tools", "tests"):
        if "SPDX-License-Identifier: Apache-2.0" not in "\n".join(text.splitlines()[:3]):
            report(path, 1, "has no SPDX line")
        if path.suffix == ".h" and path.parent.name != "urgengo" and \
                "#pragma once" not in text and "#ifndef" not in text:
            report(path, 1, "has no include guard")


def check_length():
    for path, text in sources("include", "host", "device", "interposer", "tools", "tests"):
        length = len(text.splitlines())
        if length > MAX_SOURCE_LINES:
            report(path, length, f"has more than {MAX_SOURCE_LINES} lines: split it")


def check_map():
    """host/README.md: each file that the life of a launch and what follows it names is there."""
    page = ROOT / "host/README.md"
    for number, line in enumerate(page.read_text().splitlines(), 1):
        for name in re.findall(r"`((?:\w+/)+\w*(?:\.\w+)?)`", line):
            if not (ROOT / "host" / name).exists() and not (ROOT / name).exists():
                report(page, number, f"names {name}, which is not there")


def check_settings():
    code = (ROOT / "host/base/settings.cpp").read_text()
    table = ROOT / "docs/configuration.md"
    documented = table.read_text()
    for name in re.findall(r'"(URGENGO_\w+)"', code):
        if f"| `{name}` |" not in documented:
            report(table, 1, f"does not document {name}")
    for path, text in sources("host", "interposer"):
        if path.name == "settings.cpp":
            continue
        for number, line in lines(text):
            if re.search(r'getenv\("URGENGO_', line):
                report(path, number, "reads a setting outside host/base/settings.cpp")


def check_keys():
    """Every key that the config's reader accepts stands in a row of its table, in {} or by itself."""
    code = (ROOT / "host/config/config_reader.cpp").read_text()
    table = ROOT / "docs/configuration.md"
    text = table.read_text().split("\n## Environment")[0]
    documented = {key for row in re.findall(r"^\| (`[^|]+) \|", text, re.M)
                  for key in re.findall(r"`(?:\w+: \{)?(\w+)\}?`", row)}
    for keys in re.findall(r"accept_keys\(\{(.*?)\}\)", code, re.S):
        for key in re.findall(r'"(\w+)"', keys):
            if key not in documented:
                report(table, 1, f"does not document the key {key}")


def pages():
    """Everything that is written to be read."""
    folders = ("docs", "include", "host", "device", "interposer", "tools", "tests")
    return [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md",
            *(page for folder in folders for page in sorted((ROOT / folder).rglob("*.md")))]


def check_results():
    """Every result is named by a page, and says where it comes from."""
    text = "".join(page.read_text() for page in pages())
    for path in sorted((ROOT / "tools/bench/results").iterdir()):
        if path.name not in text:
            report(path, 1, "is named by no page: delete it")
        if path.suffix != ".json":
            continue
        content = json.loads(path.read_text())
        missing = {what for its in content.get("parts", {"": content}).values()
                   for what, keys in RESULT_HEAD.items()
                   if not any(its.get(key) or content.get(key) for key in keys)}
        if missing != INCOMPLETE_RESULTS.get(path.name, set()):
            report(path, 1, f"lacks {sorted(missing)}, expected: "
                            f"{sorted(INCOMPLETE_RESULTS.get(path.name, set()))}")


def check_documents():
    """The front page is short, links lead somewhere, and results that are named are there."""
    readme = ROOT / "README.md"
    if len(readme.read_text().splitlines()) > MAX_README_LINES:
        report(readme, 1, f"has more than {MAX_README_LINES} lines")
    for path in pages():
        for number, line in enumerate(path.read_text().splitlines(), 1):
            for link in re.findall(r"\]\(([^)#]+)[^)]*\)", line):
                if "://" not in link and not (path.parent / link).exists():
                    report(path, number, f"links to {link}, which is not there")
            for name in re.findall(r"20\d\d-\d\d-\d\d_\w+(?:\.\w+)*\.(?:json|svg)", line):
                if not (ROOT / "tools/bench/results" / name).exists():
                    report(path, number, f"names the result {name}, which is not there")


for check in (check_layers, check_boundary, check_messages, check_words, check_headers, check_length,
              check_map, check_settings, check_keys, check_documents, check_results):
    check()
if problems:
    sys.exit("\n".join(problems))
